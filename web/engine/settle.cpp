// settle FILE SCENE OUT [X:Y]: draws a file in a session until its picture is the finest. SCENE may be empty: one that
// fits the data. With X:Y, a hand first drags the camera by so many pixels. OUT: as of draw.
#include <fmt/format.h>

#include <cstdio>
#include <optional>
#include <span>
#include <string>
#include <utility>

#include "player/session.h"
#include "player/steering.h"
#include "web/engine/output.h"

namespace splatvol {
namespace {

constexpr int width = 512, height = 512;

Status draw_finest(Session& session) {
  do SPLATVOL_TRY(session.draw(width, height, 1));
  while (!session.is_settled());
  return {};
}

Status drag(Session& session, const dvec2& by) {
  const SteeredPicture picture{.viewport = {width, height}};
  const dvec2 from(width / 2.0, height / 2.0), to = from + by;
  Steering steering;
  for (const Event& event : {Event(PointerMoved{from.x, from.y}), Event(ButtonChanged{0, true}),
                             Event(PointerMoved{to.x, to.y}), Event(ButtonChanged{0, false})})
    steering.handle(event, &session, picture, {});
  return draw_finest(session);
}

Status settle(std::span<char* const> words) {
  const ViewSettings settings{.memory = 256u << 20, .device = Device::cpu, .in_current_context = false};
  SPLATVOL_TRY_ASSIGN(file, Session::read({.file = words[0]}, words[1], settings));
  InlineHost host;
  SPLATVOL_TRY_ASSIGN(session, Session::open(std::move(file), host));
  SPLATVOL_TRY(draw_finest(*session));
  double x = 0, y = 0;
  if (words.size() > 3 && std::sscanf(words[3], "%lf:%lf", &x, &y) == 2) SPLATVOL_TRY(drag(*session, {x, y}));
  SPLATVOL_TRY_ASSIGN(image, session->image());
  return write_pixels(words[2], image);
}

}  // namespace
}  // namespace splatvol

int main(int argc, char** argv) {
  const std::span<char* const> words(argv + 1, static_cast<std::size_t>(argc - 1));
  if (words.size() < 3) {
    fmt::print(stderr, "usage: settle FILE SCENE OUT [X:Y]\n");
    return 2;
  }
  const splatvol::Status settled = splatvol::settle(words);
  if (!settled) fmt::print(stderr, "{}\n", settled.error().message);
  return settled ? 0 : 1;
}
