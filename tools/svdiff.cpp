// svdiff: the difference between two pictures.
#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "base/json.h"
#include "pictures/image.h"
#include "tools/tool.h"

namespace splatvol {
namespace {

void print_text(const ImageDifference& difference, const SeenDifference& seen) {
  print_out("rmse {:.6g}\npsnr {:.4f} dB\nmax {:.6g}\nmean {:.6g} {:.6g}\nripple {:.6g}\noutline {:.6g}\n",
            difference.rmse, difference.psnr, difference.max, difference.mean_a, difference.mean_b, seen.ripple,
            seen.outline);
}

/// JSON has no infinity: the PSNR of equal pictures is null.
void print_json(const ImageDifference& difference, const SeenDifference& seen) {
  const nlohmann::ordered_json document = {{"rmse", difference.rmse}, {"psnr", difference.psnr},
                                           {"max", difference.max},   {"mean", {difference.mean_a, difference.mean_b}},
                                           {"ripple", seen.ripple},   {"outline", seen.outline}};
  fmt::print("{}\n", json_text(document, 1));
}

Status compare_files(const std::string& path_a, const std::string& path_b, bool json) {
  SPLATVOL_TRY_ASSIGN(a, read_exr(path_a));
  SPLATVOL_TRY_ASSIGN(b, read_exr(path_b));
  const auto difference = compare_images(a, b);
  if (!difference) return fail_in(path_a + " and " + path_b, difference.error());
  SPLATVOL_TRY_ASSIGN(seen, compare_as_seen(a, b));
  json ? print_json(*difference, seen) : print_text(*difference, seen);
  return {};
}

}  // namespace
}  // namespace splatvol

int main(int argc, char** argv) {
  splatvol::CommandLine app(
      "Compares two EXR pictures of the same size: linear premultiplied RGB. ripple: the error beside the outline that "
      "is narrower than 16 pixels; outline: the error within 3 pixels of where A ends.",
      "svdiff");
  std::string path_a;
  std::string path_b;
  bool json = false;
  app.add_option("A", path_a, "EXR file; the exact picture if there is one")->type_name("A.exr")->required();
  app.add_option("B", path_b, "EXR file")->type_name("B.exr")->required();
  app.add_flag("--json", json, "Print JSON");
  return splatvol::run_tool(app, argc, argv, [&] { return splatvol::compare_files(path_a, path_b, json); });
}
