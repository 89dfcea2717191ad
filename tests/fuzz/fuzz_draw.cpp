// A whole .svol file, from the disk or from a server, drawn by the processor: as splats, or exactly as cells. The first
// bytes of an input choose kernel, camera and detail; the file follows.
#include <oneapi/tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "base/file.h"
#include "base/part_table.h"
#include "renderer/cpu/cells.h"
#include "renderer/cpu/tile_rasterizer.h"
#include "renderer/slice_values.h"
#include "streamer/cells/file_cells.h"
#include "streamer/first/default_scene.h"
#include "streamer/splats/streamer.h"
#include "tests/fuzz/fuzz.h"
#include "tests/fuzz/svol_mutator.h"
#include "tests/support/memory_source.h"

using namespace splatvol;
using splatvol::fuzz::require;

namespace {

constexpr int side = 16;  // of the picture, in pixels

struct Settings {
  std::uint8_t attribute, kernel, direction, distance, detail, drawing, light, step;
};
static_assert(sizeof(Settings) == 8);

// Bytes as on a web server: bytes are read ahead, and joined.
class FarBytes final : public ByteSource {
 public:
  // `knows_parts`: whether a request may name several ranges.
  FarBytes(std::span<const std::byte> bytes, bool knows_parts)
      : near_(memory_source(bytes, "fuzz")), knows_parts_(knows_parts) {}
  [[nodiscard]] std::uint64_t size() const override { return near_->size(); }
  [[nodiscard]] const std::string& name() const override { return near_->name(); }
  [[nodiscard]] std::uint64_t cheap_gap() const override { return std::uint64_t{64} << 10; }
  [[nodiscard]] bool may_read_parts() const override { return knows_parts_; }
  [[nodiscard]] Status read(std::uint64_t offset, std::span<std::byte> out) override {
    return near_->read(offset, out);
  }
  [[nodiscard]] Result<bool> read_parts(std::span<const Part> parts) override {
    if (!knows_parts_) return false;
    std::uint64_t end = 0;
    for (const Part& part : parts) {
      require(part.offset >= end, "parts of a request ascend");
      end = part.offset + part.out.size();
      require(end <= size(), "parts of a request are in the file");
      SPLATVOL_TRY(near_->read(part.offset, part.out));
    }
    return true;
  }

 private:
  std::unique_ptr<ByteSource> near_;
  bool knows_parts_;
};

std::unique_ptr<ByteSource> source_of(const Settings& settings, std::span<const std::byte> bytes) {
  if (settings.drawing & 64) return std::make_unique<FarBytes>(bytes, (settings.drawing & 128) != 0);
  return memory_source(bytes, "fuzz");
}

Camera camera_of(const Settings& settings, const Cube& cube) {
  Camera camera;
  const double angle = settings.direction / 40.0;
  const double distance = cube.edge * std::exp2((settings.distance & 15) / 2.0 - 4);
  camera.focal_point = cube.origin + dvec3(0.5 * cube.edge);
  camera.position = camera.focal_point + distance * dvec3(std::cos(angle), 0.3, std::sin(angle));
  camera.parallel_height = 1.2 * cube.edge;
  if (settings.distance & 16) camera.projection = Camera::Projection::orthographic;
  return camera;
}

Detail detail_of(const Settings& settings) {
  Detail detail;
  detail.tolerance_percent = (settings.detail & 3) * 5.0;
  if (settings.detail & 4) detail.resolution = settings.detail >> 4;
  if (settings.detail & 8) detail.goal = ErrorGoal{0.01 * (settings.detail >> 4), 1000};
  return detail;
}

bool is_number(const Image& image) {
  for (const vec4& pixel : image.pixels)
    for (int channel = 0; channel < 4; ++channel)
      if (std::isnan(pixel[channel])) return false;
  return true;
}

// A scene of which many files have the transfer function: its tables take longer than all the rest.
Scene common_scene(const Settings& settings, const format::VolumeInfo& info, const format::Attribute& attribute) {
  Scene scene;
  scene.width = scene.height = side;
  scene.camera = camera_of(settings, info.cube);
  const double largest = std::max({std::abs(attribute.min), std::abs(attribute.max), 1e-100});
  TransferFunction& function = scene.transfer_function;
  function.hi = std::exp2(std::ceil(std::log2(largest) / 8) * 8);
  function.lo = settings.light & 16 ? -function.hi : 0;
  function.colors = {{0, {0, 0, 1}}, {1, {1, 1, 0}}};
  function.densities = {{0, 0}, {0.001, 1}, {0.5, 0.1}, {1, settings.attribute & 128 ? 1e30 : 10}};
  if (settings.light & 32) function.axis = ValueAxis::asinh, function.linear_width = function.hi / 1000;
  return scene;
}

// Returns a rasterizer with this transfer function.
Result<TileRasterizer*> rasterizer_for(KernelKind kernel, const Scene& scene, const DrawingUnits& units) {
  struct Kept {
    KernelKind kernel;
    TransferFunction function;
    std::optional<SceneOpacity> opacity;
    DrawingUnits units;
    std::unique_ptr<TileRasterizer> rasterizer;
  };
  static std::vector<Kept> all;
  for (const Kept& kept : all)
    if (kept.kernel == kernel && kept.function == scene.transfer_function && kept.opacity == scene.opacity &&
        kept.units == units)
      return kept.rasterizer.get();
  if (all.size() == 16) all.erase(all.begin());
  auto rasterizer = std::make_unique<TileRasterizer>(kernel);
  SPLATVOL_TRY(rasterizer->set_transfer_function(transfer_of(scene), units));
  return all.emplace_back(Kept{kernel, scene.transfer_function, scene.opacity, units, std::move(rasterizer)})
      .rasterizer.get();
}

// The splats at once, or part by part.
Result<const FrameSplats*> frame_of(Streamer& streamer, const View& view, const Transfer& transfer,
                                    const Settings& settings) {
  const Detail detail = detail_of(settings);
  if (!(settings.kernel & 2)) return streamer.request(view, transfer, detail);
  for (int call = 0;; ++call) {
    SPLATVOL_TRY_ASSIGN(frame, streamer.advance(view, transfer, detail, 0.005));
    if (frame->progress.settled || call == 8) return frame;
  }
}

Status draw_cells(const format::Volume& volume, const Settings& settings, Scene scene, const View& view) {
  if (settings.step & 64) scene.contours = {{.values = {0, 0.3 * scene.transfer_function.hi}, .opacity = 0.5}};
  const PartRoom room = own_room(std::uint64_t{1} << (settings.step & 128 ? 14 : 24));
  SPLATVOL_TRY_ASSIGN(kept, KeptCells::open(volume, scene, room));
  if (settings.step & 32) SPLATVOL_TRY(kept->hold_all());
  SPLATVOL_TRY_ASSIGN(cells, FileCells::open(std::move(kept), scene, view));
  SPLATVOL_TRY_ASSIGN(segments, cells->estimate_segments());
  require(segments >= 0, "estimates are numbers");
  CellDrawing drawing{.view = view, .transfer = transfer_of(scene)};
  if (settings.light & 1) drawing.lighting = Lighting{};
  drawing.contours = contours_of(scene);
  drawing.sample_spacing = 1 + (settings.drawing >> 3 & 3);
  drawing.refined_difference = settings.drawing & 2 ? 0.01F : 0;
  drawing.memory = std::uint64_t{1} << (settings.drawing & 4 ? 16 : 26);
  SPLATVOL_TRY_ASSIGN(drawn, CellRasterizer().draw(*cells, drawing));
  require(is_number(drawn.image), "pixels of cells are numbers");
  return {};
}

Status draw(const std::shared_ptr<const format::Volume>& volume, const Settings& settings) {
  const format::VolumeInfo& info = volume->info();
  if (info.attributes.empty()) return {};
  const format::Attribute& attribute = info.attributes[(settings.attribute & 127) % info.attributes.size()];
  StreamerOptions options{.memory_bytes = std::uint64_t{1} << (settings.step & 128 ? 21 : 26),
                          .attribute = attribute.name,
                          .kernel = settings.kernel & 1 ? KernelKind::octant : KernelKind::moments,
                          .gradients = (settings.light & 1) != 0,
                          .threads = 1};
  const bool fades = settings.drawing & 32;
  const format::Attribute& opacity = info.attributes[((settings.attribute & 127) + 1) % info.attributes.size()];
  if (fades) options.opacity_attribute = opacity.name;
  Scene scene = common_scene(settings, info, attribute);
  scene.attribute = attribute.name;
  if (fades) {
    scene.opacity = SceneOpacity{opacity.name, common_scene(settings, info, opacity).transfer_function};
    scene.opacity->function.densities = {{0, 0.1}, {0.5, 1}, {0.5, 0}, {1, 0.7}};
  }
  if (settings.light & 8) {
    SPLATVOL_TRY_ASSIGN(first, default_scene(*volume, attribute.name, {side, side, dvec3(0), false}));
    require(make_view(first).has_value(), "the first scene has a view");
    if (settings.light & 2) scene.camera = first.camera;
    if (settings.light & 64) scene.transfer_function = first.transfer_function;
  }
  if (settings.light & 4)
    scene.clip_box = Box{info.cube.origin + 0.2 * info.cube.edge, info.cube.origin + 0.7 * info.cube.edge};
  if (settings.light & 128) {
    const dvec3 middle = info.cube.origin + 0.45 * info.cube.edge;
    scene.slices = {{middle, {0.3, -0.7, 0.5}}};
    scene.clip_planes = {{middle, {1, 0.25, 0}}};
  }
  SPLATVOL_TRY_ASSIGN(view, make_view(scene));
  if (settings.drawing & 1) return draw_cells(*volume, settings, scene, view);

  SPLATVOL_TRY_ASSIGN(streamer, Streamer::open(volume, options));
  SPLATVOL_TRY_ASSIGN(frame, frame_of(*streamer, view, transfer_of(scene), settings));
  for (const Slice& slice : view.slices) {
    const std::vector<double> depths(static_cast<std::size_t>(view.width) * view.height, info.cube.edge);
    const auto values = slice_values(frame->sliced, streamer->units(), view, slice.plane, depths);
    require(std::ranges::none_of(values, [](double value) { return std::isinf(value); }), "values are numbers");
  }
  SPLATVOL_TRY_ASSIGN(rasterizer, rasterizer_for(options.kernel, scene, streamer->units()));
  rasterizer->set_lighting(settings.light & 1 ? std::optional(Lighting{}) : std::nullopt);
  SPLATVOL_TRY(rasterizer->set_draw_list(frame->list));
  constexpr SortMode sorts[] = {SortMode::none, SortMode::axis, SortMode::exact, SortMode::exact};
  SPLATVOL_TRY(rasterizer->draw(view, sorts[settings.drawing >> 1 & 3], 1 + (settings.drawing >> 3 & 3)));
  require(is_number(*std::get<const Image*>(rasterizer->picture())), "pixels are numbers");
  SPLATVOL_TRY(rasterizer->set_draw_list({}));
  return {};
}

}  // namespace

// TBB keeps data of threads in memory where the leak sanitizer does not look.
extern "C" const char* __asan_default_options();
extern "C" const char* __asan_default_options() { return "detect_leaks=0"; }

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const oneapi::tbb::global_control one_thread(oneapi::tbb::global_control::max_allowed_parallelism, 1);
  fuzz::Input input(fuzz::bytes_of(data, size));
  const auto settings = input.take<Settings>();
  auto volume = format::Volume::open(source_of(settings, input.rest()));
  if (!volume) return 0;
  if (const format::Series* series = (*volume)->series()) {
    auto at_step = (*volume)->at_step(settings.step % series->steps.size());
    if (!at_step) return 0;
    volume = std::move(at_step);
  }
  static_cast<void>(draw(*volume, settings));
  return 0;
}

extern "C" std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size, std::size_t max_size,
                                               unsigned seed) {
  constexpr std::size_t front = sizeof(Settings);
  if (size <= front) return LLVMFuzzerMutate(data, size, max_size);
  if (seed % 4 == 0) {
    LLVMFuzzerMutate(data, front, front);
    return size;
  }
  return front + fuzz::mutate_volume(data + front, size - front, max_size - front, seed);
}
