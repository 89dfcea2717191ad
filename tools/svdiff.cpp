// svdiff: the difference between two pictures.
#include <nlohmann/json.hpp>

#include "scene/image.h"
#include "tools/tool.h"

namespace splatvol {
namespace {

void print_text(const ImageDifference& difference) {
  fmt::print("rmse {:.6g}\npsnr {:.4f} dB\nmax {:.6g}\nmean {:.6g} {:.6g}\n", difference.rmse, difference.psnr,
             difference.max, difference.mean_a, difference.mean_b);
}

/// JSON has no infinity: the PSNR of equal pictures is null.
void print_json(const ImageDifference& difference) {
  const nlohmann::ordered_json document = {{"rmse", difference.rmse},
                                           {"psnr", difference.psnr},
                                           {"max", difference.max},
                                           {"mean", {difference.mean_a, difference.mean_b}}};
  fmt::print("{}\n", document.dump(1));
}

Status compare_files(const std::string& path_a, const std::string& path_b, bool json) {
  SPLATVOL_TRY_ASSIGN(a, read_exr(path_a));
  SPLATVOL_TRY_ASSIGN(b, read_exr(path_b));
  const auto difference = compare_images(a, b);
  if (!difference) return fail_in(path_a + " and " + path_b, difference.error());
  json ? print_json(*difference) : print_text(*difference);
  return {};
}

}  // namespace
}  // namespace splatvol

int main(int argc, char** argv) {
  CLI::App app("Compares two EXR pictures of the same size: linear premultiplied RGB, alpha left out.", "svdiff");
  std::string path_a;
  std::string path_b;
  bool json = false;
  app.add_option("A", path_a, "EXR file")->required();
  app.add_option("B", path_b, "EXR file")->required();
  app.add_flag("--json", json, "Print JSON");
  return splatvol::run_tool(app, argc, argv, [&] { return splatvol::compare_files(path_a, path_b, json); });
}
