// draw FILE SCENE OUT [exact] [FRAMES]: draws a scene of a file, in node or on a desktop: all points, or the exact
// picture. OUT gets its pixels (output.h). Prints the median time of a frame.
#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <span>
#include <string>
#include <vector>

#include "base/clock.h"
#include "player/player.h"
#include "web/engine/output.h"

namespace splatvol {
namespace {

struct Request {
  std::string file, scene, output;
  bool is_exact = false;
  int frames = 1;
};

double median(std::vector<double> numbers) {
  const auto middle = numbers.begin() + static_cast<std::ptrdiff_t>(numbers.size() / 2);
  std::ranges::nth_element(numbers, middle);
  return *middle;
}

Status draw(const Request& request) {
  const auto begin = Clock::now();
  SPLATVOL_TRY_ASSIGN(scene, load_scene(request.scene));
  SPLATVOL_TRY_ASSIGN(player, Player::open(request.file, scene, {.memory = 256u << 20, .device = Device::cpu}));
  fmt::print("open {:.1f} ms\n", 1e3 * seconds_since(begin));
  Quality quality;
  if (request.is_exact)
    quality.exact = true;
  else
    quality.tolerance_percent = 0;
  std::vector<double> seconds;
  for (int frame = 0; frame < request.frames; ++frame) {
    const auto start = Clock::now();
    SPLATVOL_TRY(player->draw_picture(quality));
    seconds.push_back(seconds_since(start));
  }
  const double least = *std::ranges::min_element(seconds), first = seconds[0];
  fmt::print("first {:.1f} ms, median of {} {:.1f} ms, least {:.1f} ms\n", 1e3 * first, seconds.size(),
             1e3 * median(std::move(seconds)), 1e3 * least);
  SPLATVOL_TRY_ASSIGN(image, player->image());
  return write_pixels(request.output, image);
}

}  // namespace
}  // namespace splatvol

int main(int argc, char** argv) {
  const std::span<char*> words(argv, static_cast<std::size_t>(argc));
  if (words.size() < 4) {
    fmt::print(stderr, "usage: draw FILE SCENE OUT [exact] [FRAMES]\n");
    return 2;
  }
  splatvol::Request request{words[1], words[2], words[3]};
  for (const std::string word : words.subspan(4))
    word == "exact" ? static_cast<void>(request.is_exact = true)
                    : static_cast<void>(request.frames = std::max(1, std::atoi(word.c_str())));
  const splatvol::Status drawn = splatvol::draw(request);
  if (!drawn) fmt::print(stderr, "{}\n", drawn.error().message);
  return drawn ? 0 : 1;
}
