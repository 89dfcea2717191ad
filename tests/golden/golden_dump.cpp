// golden_dump [--all] FILE.svol: prints what a reader sees, as the golden test compares it. golden_dump --picture
// FILE.svol: prints small pictures of it, by its scene. golden_dump --make-pages OUT.svol: writes a small
// file whose index and directory have several pages.
#include <fmt/format.h>

#include <random>
#include <string>

#include "base/file.h"
#include "format/volume.h"
#include "tests/golden/golden_picture.h"
#include "tests/support/test_volume.h"
#include "tests/support/volume_dump.h"

namespace splatvol::test {
namespace {

Status make_pages(const std::string& path) {
  constexpr std::size_t points = 320;
  std::mt19937 random(5);
  std::vector<double> values(points);
  for (double& value : values) value = static_cast<double>(random() % 1000) / 8;
  return write_test_volume(
      make_test_volume(random_points(points, 3), {values},
                       {.node_points = 1, .position_error = 1e-3, .moments = false, .gradients = false}),
      path);
}

Status print(const std::string& path, bool all) {
  SPLATVOL_TRY_ASSIGN(file, open_file(path));
  SPLATVOL_TRY_ASSIGN(volume, format::Volume::open(std::move(file)));
  SPLATVOL_TRY(volume->verify([](double) {}));
  SPLATVOL_TRY_ASSIGN(text, dump_volume(*volume, all));
  fmt::print("{}", text);
  return {};
}

Status print_picture(const std::string& path) {
  SPLATVOL_TRY_ASSIGN(scene, golden_scene(path));
  SPLATVOL_TRY_ASSIGN(text, golden_picture(path, scene));
  fmt::print("{}", text);
  return {};
}

Status act(const std::string& option, const std::string& path) {
  if (option == "--make-pages") return make_pages(path);
  if (option == "--picture") return print_picture(path);
  return print(path, option == "--all");
}

}  // namespace
}  // namespace splatvol::test

int main(int argc, char** argv) {
  const std::string option = argc > 1 ? argv[1] : "";
  const bool has_option = option.starts_with("--");
  const bool known = option == "--all" || option == "--picture" || option == "--make-pages";
  if (argc != (has_option ? 3 : 2) || (has_option && !known)) {
    fmt::print(stderr, "usage: golden_dump [--all | --picture] FILE.svol | --make-pages OUT.svol\n");
    return 2;
  }
  const splatvol::Status done = splatvol::test::act(option, argv[argc - 1]);
  if (!done) fmt::print(stderr, "golden_dump: {}\n", done.error().message);
  return done ? 0 : 1;
}
