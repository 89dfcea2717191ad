#include "tests/golden/golden_picture.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

#include "base/file.h"
#include "base/json.h"
#include "renderer/cpu/cells.h"
#include "renderer/cpu/tile_rasterizer.h"
#include "streamer/cells/file_cells.h"
#include "streamer/splats/streamer.h"

namespace splatvol::test {
namespace {

Result<Image> draw(Streamer& streamer, const Scene& scene) {
  SPLATVOL_TRY_ASSIGN(view, make_view(scene));
  SPLATVOL_TRY_ASSIGN(frame, streamer.request(view, scene.transfer_function, {.tolerance_percent = 0}));
  TileRasterizer rasterizer(streamer.kernel());
  SPLATVOL_TRY(rasterizer.set_transfer_function(scene.transfer_function, streamer.units()));
  SPLATVOL_TRY(rasterizer.set_draw_list(frame->list));
  SPLATVOL_TRY(rasterizer.draw(view, SortMode::exact, 1));
  return rasterizer.read_image();
}

Result<Image> draw_cells(const format::Volume& volume, const Scene& scene) {
  SPLATVOL_TRY_ASSIGN(view, make_view(scene));
  SPLATVOL_TRY_ASSIGN(kept, KeptCells::open(volume, scene, own_room(std::uint64_t{1} << 24)));
  SPLATVOL_TRY_ASSIGN(cells, FileCells::open(std::move(kept), scene, view));
  SPLATVOL_TRY_ASSIGN(drawn, CellRasterizer().draw(*cells, {.view = view, .transfer = transfer_of(scene)}));
  return std::move(drawn.image);
}

vec4 mean_of_block(const Image& image, int left, int top) {
  vec4 sum(0);
  for (int y = 0; y < golden_block; ++y)
    for (int x = 0; x < golden_block; ++x) sum += image.at(left + x, top + y);
  return sum * (1.0F / (golden_block * golden_block));
}

Result<std::string> text_of(const Image& image) {
  std::string text;
  float largest = 0;
  for (int top = 0; top < golden_size; top += golden_block) {
    for (int left = 0; left < golden_size; left += golden_block) {
      const vec4 mean = mean_of_block(image, left, top);
      largest = std::max(largest, mean.a);
      for (int i = 0; i < 4; ++i)
        text += fmt::format("{:04x}", static_cast<unsigned>(std::lround(65535 * std::clamp(mean[i], 0.0F, 1.0F))));
    }
    text += '\n';
  }
  if (!(largest > 0.01F)) return fail(ErrorCode::invalid_argument, "the picture is empty");
  return text;
}

}  // namespace

Result<Scene> golden_scene(const std::filesystem::path& file) {
  SPLATVOL_TRY_ASSIGN(common, read_text_file(file.parent_path() / "scene.json"));
  SPLATVOL_TRY_ASSIGN(own, read_text_file(std::filesystem::path(file).replace_extension(".json")));
  nlohmann::json scene = parse_json(common);
  scene.merge_patch(parse_json(own));
  return parse_scene(json_text(scene));
}

Result<std::string> golden_picture(const std::string& file, const Scene& scene) {
  Scene small = scene;
  small.width = small.height = golden_size;
  SPLATVOL_TRY_ASSIGN(described, open_file(file));
  SPLATVOL_TRY_ASSIGN(volume, format::Volume::open(std::move(described)));
  SPLATVOL_TRY_ASSIGN(source, open_file(file));
  const bool moments = volume->info().find_column(format::ColumnKind::moments) >= 0;
  const KernelKind kernel = moments ? KernelKind::moments : KernelKind::octant;
  SPLATVOL_TRY_ASSIGN(streamer, Streamer::open(std::move(source), {.attribute = small.attribute, .kernel = kernel}));
  SPLATVOL_TRY_ASSIGN(splats, draw(*streamer, small));
  SPLATVOL_TRY_ASSIGN(blocks, text_of(splats));
  std::string text = fmt::format("splats\n{}", blocks);
  if (volume->file_info().cells) {
    SPLATVOL_TRY_ASSIGN(cells, draw_cells(*volume, small));
    SPLATVOL_TRY_ASSIGN(blocks_of_cells, text_of(cells));
    text += fmt::format("cells\n{}", blocks_of_cells);
  }
  return text;
}

}  // namespace splatvol::test
