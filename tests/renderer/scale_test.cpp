// From mesh to file to picture: a picture does not depend on the units and zeros of lengths and values, nor on what is
// stored beside it.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "builder/pipeline/build.h"
#include "builder/sources/generator.h"
#include "renderer/cpu/tile_rasterizer.h"
#include "renderer/gl/context.h"
#include "renderer/gl/gl_rasterizer.h"
#include "renderer/reference/reference.h"
#include "streamer/first/default_scene.h"
#include "streamer/splats/streamer.h"
#include "tests/support/long.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

// Units of lengths and values, and where they are counted from.
struct Scales {
  double length = 1, value = 1;
  double origin = 0, zero = 0;  // in these units

  dvec3 place(const dvec3& p) const { return length * (p + dvec3(origin)); }
};

/// A generated mesh in other units. Its attributes are "value"; "tiny", "huge" and "small", the same times 1e-40, 1e51
/// and the least normal number of double precision; and "signed", which is 0 or -0.
class ScaledMesh final : public Source {
 public:
  /// `first`: the first point's "value" instead of its own.
  explicit ScaledMesh(const Scales& scales, std::optional<double> first = std::nullopt)
      : scales_(scales), first_(first), mesh_(generate_mesh({.cells = 3000}).value()) {}

  const std::vector<std::string>& attributes() const override {
    static const std::vector<std::string> names = {"value", "tiny", "huge", "small", "signed"};
    return names;
  }
  std::size_t piece_count() const override { return mesh_->piece_count(); }

  Result<std::unique_ptr<Piece>> next() override {
    SPLATVOL_TRY_ASSIGN(piece, mesh_->next());
    if (!piece) return std::unique_ptr<Piece>();
    for (dvec3& p : piece->points) p = scales_.place(p);
    const std::vector<double> values = piece->values[0];
    piece->values.clear();
    piece->values.push_back(values);
    for (double& value : piece->values.back()) value = scales_.value * (value + scales_.zero);
    if (first_) piece->values.back()[0] = *first_;
    for (const double factor : {1e-40, 1e51, std::numeric_limits<double>::min()}) {
      piece->values.push_back(values);
      for (double& value : piece->values.back()) value *= factor;
    }
    piece->values.emplace_back(values.size());
    for (std::size_t i = 0; i < values.size(); ++i) piece->values.back()[i] = i % 2 == 0 ? 0.0 : -0.0;
    return piece;
  }

 private:
  Scales scales_;
  std::optional<double> first_;
  std::unique_ptr<Source> mesh_;
};

TransferFunction function_in(const Scales& scales) {
  TransferFunction function{
      0.1, 0.9, {{0, dvec3(0.1, 0.2, 1)}, {1, dvec3(1, 0.4, 0)}}, {{0, 0.2}, {0.3, 0.1}, {0.6, 3}, {1, 5}}};
  function.lo = scales.value * (function.lo + scales.zero);
  function.hi = scales.value * (function.hi + scales.zero);
  for (auto& density : function.densities) density.extinction /= scales.length;
  return function;
}

Scene scene_in(const Scales& scales) {
  Scene scene;
  scene.camera.position = scales.place(dvec3(2, 2.5, 6));
  scene.camera.focal_point = scales.place(dvec3(0.2, 0, 0));
  scene.width = scene.height = 96;
  scene.attribute = "value";
  scene.transfer_function = function_in(scales);
  return scene;
}

// How a file is drawn.
enum class Way { gl, processor };

std::unique_ptr<Rasterizer> make_rasterizer(KernelKind kernel, Way way) {
  if (way == Way::gl) return GlRasterizer::create(kernel).value();
  return std::make_unique<TileRasterizer>(kernel);
}

// Builds files and draws them.
struct RendererTestBuilt : FolderTest {
  static void build(const std::string& file, ScaledMesh source) {
    BuildOptions options;
    options.gradients = true;  // for light on octants
    ASSERT_EQ(message_of(build_volume(source, file, options, [](const char*, double) {})), "");
  }

  static Image draw(const std::string& file, const Scene& scene, KernelKind kernel, const Detail& detail,
                    Way way = Way::gl) {
    const View view = make_view(scene).value();
    const auto streamer = Streamer::open(open_file(file).value(), {.memory_bytes = std::uint64_t{64} << 20,
                                                                   .attribute = scene.attribute,
                                                                   .kernel = kernel,
                                                                   .gradients = scene.lighting.has_value()})
                              .value();
    const auto renderer = make_rasterizer(kernel, way);
    renderer->set_lighting(scene.lighting);
    EXPECT_TRUE(renderer->set_transfer_function(scene.transfer_function, streamer->units()));
    const FrameSplats& frame = *streamer->request(view, scene.transfer_function, detail).value();
    EXPECT_TRUE(renderer->set_draw_list(frame.list));
    EXPECT_TRUE(renderer->draw(view, SortMode::exact, 1));
    return renderer->read_image().value();
  }

  static void expect_same(const Image& plain, const Image& scaled, double most) {
    const ImageDifference difference = compare_images(plain, scaled).value();
    EXPECT_LE(difference.rmse, most);
    EXPECT_GT(difference.mean_a, 0.03) << "there is nothing to see";
  }

  std::unique_ptr<HeadlessContext> context_ = HeadlessContext::create().value();
  std::string plain_ = path("plain.svol"), scaled_ = path("scaled.svol");
};

Image exact_picture(const Scales& scales, const Scene& scene, std::optional<double> first = std::nullopt) {
  ScaledMesh source(scales, first);
  const auto piece = source.next().value();
  return render_reference({piece->points, piece->values[0], piece->tetrahedra}, scene, {}).value().image;
}

Image exact_picture(const Scales& scales, std::optional<double> first = std::nullopt) {
  return exact_picture(scales, scene_in(scales), first);
}

/// Draws transfer functions on a mesh whose values cross 0, in every way.
class RendererTestFunctions : public RendererTestBuilt {
 protected:
  void SetUp() override { build(plain_, ScaledMesh(around_zero)); }

  static TransferFunction function(double lo, double hi, std::vector<TransferFunction::Density> densities) {
    return {lo, hi, {{0, dvec3(0.1, 0.2, 1)}, {1, dvec3(1, 0.4, 0)}}, std::move(densities)};
  }

  /// Expects that a function is drawn about as well as an easy one of about the same shape.
  void expect_as_good(const TransferFunction& hard, const TransferFunction& easy) const {
    const Image exact = exact_picture(around_zero, scene_of(hard)),
                exact_easy = exact_picture(around_zero, scene_of(easy));
    for (const auto& [kernel, way, name] : ways) {
      SCOPED_TRACE(name);
      const double usual = rmse(kernel, way, easy, exact_easy);
      EXPECT_LT(rmse(kernel, way, hard, exact), 1.05 * usual + 5e-4);
      const double signal = compare_images(exact, empty()).value().rmse;
      EXPECT_LT(usual, 0.6 * signal) << "the test tells an empty picture from a right one";
    }
  }

 private:
  static constexpr Scales around_zero{1, 1, 0, -0.5};
  static constexpr std::array<std::tuple<KernelKind, Way, const char*>, 4> ways{
      {{KernelKind::moments, Way::gl, "OpenGL"},
       {KernelKind::moments, Way::processor, "processor"},
       {KernelKind::octant, Way::gl, "octant, OpenGL"},
       {KernelKind::octant, Way::processor, "octant, processor"}}};

  static Scene scene_of(const TransferFunction& function) {
    Scene scene = scene_in({});
    scene.transfer_function = function;
    return scene;
  }
  static Image empty() {
    const Scene scene = scene_in({});
    return {scene.width, scene.height, std::vector<vec4>(std::size_t{96} * 96, vec4(0))};
  }
  double rmse(KernelKind kernel, Way way, const TransferFunction& function, const Image& exact) const {
    return compare_images(draw(plain_, scene_of(function), kernel, {.tolerance_percent = 0}, way), exact).value().rmse;
  }
};

// A domain that is narrow beside the values is a jump.
TEST_F(RendererTestFunctions, DomainsMayBeNarrow) {
  const auto ramp = [](double width) { return function(0, width, {{0, 0.2}, {1, 3}}); };
  for (const double width : {1e-12, 1e-16, 1e-20, 1e-22, 1e-30, 1e-38, 1e-45, 1e-60}) {
    SCOPED_TRACE(width);
    expect_as_good(ramp(width), ramp(1e-6));
  }
}

TEST_F(RendererTestFunctions, DomainsMayBeWide) {
  const auto ramp = [](double lo, double hi) { return function(lo, hi, {{0, 0.2}, {0.5, 2}, {1, 3}}); };
  for (const double width : {1e12, 1e30, 1e38, 1e40, 1e60, 1e99}) {
    SCOPED_TRACE(width);
    expect_as_good(ramp(-width, width), ramp(-1e6, 1e6));
    expect_as_good(ramp(-0.1 * width, width), ramp(-0.1e6, 1e6));
  }
}

TEST_F(RendererTestFunctions, MatterMayBeOpaque) {
  for (const double extinction : {1e12, 1e20, 1e30, 1e38, 1e39, 1e60, 1e99}) {
    SCOPED_TRACE(extinction);
    expect_as_good(function(-0.4, 0.4, {{0, extinction}, {1, extinction}}), function(-0.4, 0.4, {{0, 1e6}, {1, 1e6}}));
  }
}

// Of equal control points at an end, the outer one holds beyond it: as a function with its jumps inside of a domain
// that is half as wide again.
TEST_F(RendererTestFunctions, MayJumpAtTheEndsOfTheDomain) {
  constexpr double low = 1. / 6, high = 5. / 6;
  const dvec3 red(1, 0, 0), green(0, 1, 0);
  const auto check = [&](double half_width, double outside, double within) {
    TransferFunction at_ends =
        function(-half_width, half_width, {{0, outside}, {0, within}, {1, within}, {1, outside}});
    at_ends.colors = {{0, red}, {0, green}, {1, green}, {1, red}};
    TransferFunction inside =
        function(-1.5 * half_width, 1.5 * half_width, {{low, outside}, {low, within}, {high, within}, {high, outside}});
    inside.colors = {{low, red}, {low, green}, {high, green}, {high, red}};
    expect_as_good(at_ends, inside);
  };
  check(0.1, 1, 3);
  check(0.02, 3, 0);
}

struct RendererTestScales : RendererTestBuilt, testing::WithParamInterface<Scales> {
  void SetUp() override {
    build(plain_, ScaledMesh({}));
    build(scaled_, ScaledMesh(GetParam()));
  }

  // Powers of two round nothing. Powers of ten round positions: of two points at one distance from the middle of a node
  // the other may stay for the coarser resolution.
  static double tolerance() {
    const auto is_power_of_two = [](double number) { return std::exp2(std::ilogb(number)) == number; };
    return !is_shifted() && is_power_of_two(GetParam().length) && is_power_of_two(GetParam().value) ? 0 : 3e-4;
  }

  static bool is_shifted() { return GetParam().origin != 0 || GetParam().zero != 0; }

  // Draws both files by a change of the scene that `edit` makes, given the scales.
  template <class Edit>
  void check(KernelKind kernel, const Detail& detail, const Edit& edit, Way way = Way::gl) const {
    Scene plain = scene_in({}), scaled = scene_in(GetParam());
    edit(plain, Scales{});
    edit(scaled, GetParam());
    expect_same(draw(plain_, plain, kernel, detail, way), draw(scaled_, scaled, kernel, detail, way), tolerance());
  }
};

TEST_P(RendererTestScales, DoNotChangeThePicture) {
  const auto as_is = [](Scene&, const Scales&) {};
  check(KernelKind::moments, {.tolerance_percent = 0}, as_is);
  check(KernelKind::moments, {.tolerance_percent = 10}, as_is);
  check(KernelKind::moments, {.goal = ErrorGoal{0, 300}}, as_is);
  check(KernelKind::octant, {.tolerance_percent = 2}, as_is);
}

TEST_P(RendererTestScales, DoNotChangeThePictureOfTheProcessor) {
  const auto as_is = [](Scene&, const Scales&) {};
  const auto parallel = [](Scene& scene, const Scales& scales) {
    scene.camera.projection = Camera::Projection::orthographic;
    scene.camera.parallel_height = 4 * scales.length;
  };
  check(KernelKind::moments, {.tolerance_percent = 0}, as_is, Way::processor);
  check(KernelKind::moments, {.tolerance_percent = 10}, as_is, Way::processor);
  check(KernelKind::moments, {.tolerance_percent = 1}, parallel, Way::processor);
  check(KernelKind::octant, {.tolerance_percent = 2}, as_is, Way::processor);
}

TEST_P(RendererTestScales, DoNotChangeLightClipBoxAndParallelRays) {
  const auto light = [](Scene& scene, const Scales&) { scene.lighting = Lighting{}; };
  check(KernelKind::moments, {.tolerance_percent = 1}, light);
  check(KernelKind::octant, {.tolerance_percent = 1}, light);
  const auto clip = [](Scene& scene, const Scales& scales) {
    scene.clip_box = Box{scales.place(dvec3(-1.5, -1, -0.9)), scales.place(dvec3(1, 1.3, 0.5))};
  };
  check(KernelKind::moments, {.tolerance_percent = 1}, clip);
  check(KernelKind::octant, {.tolerance_percent = 1}, clip);
  check(KernelKind::moments, {.tolerance_percent = 1}, [](Scene& scene, const Scales& scales) {
    scene.camera.projection = Camera::Projection::orthographic;
    scene.camera.parallel_height = 4 * scales.length;
  });
}

// Attributes far beyond single precision, beside others.
TEST_P(RendererTestScales, MixInOneFile) {
  const Image plain = draw(plain_, scene_in({}), KernelKind::moments, {.tolerance_percent = 1});
  for (const auto& [name, scale] :
       {std::pair("tiny", 1e-40), std::pair("huge", 1e51), std::pair("small", std::numeric_limits<double>::min())}) {
    Scene scene = scene_in({GetParam().length, scale, GetParam().origin});
    scene.attribute = name;
    // The squares of the smallest values vanish in double precision too: their splats have one value.
    expect_same(plain, draw(scaled_, scene, KernelKind::moments, {.tolerance_percent = 1}),
                scale < 1e-300 ? 0.05 : 3e-4);
  }
  const auto volume = format::Volume::open(open_file(scaled_).value()).value();
  for (const format::Attribute& attribute : volume->info().attributes) EXPECT_EQ(attribute.missing, 0u);
  EXPECT_EQ(volume->info().attributes[4].scale, 1);
  EXPECT_EQ(volume->info().attributes[4].max, 0);
}

TEST_P(RendererTestScales, DoNotChangeTheDefaultScene) {
  const auto open = [](const std::string& file) { return format::Volume::open(open_file(file).value()).value(); };
  const Scene plain = default_scene(*open(plain_), "value").value();
  const Scene scaled = default_scene(*open(scaled_), "value").value();
  const double distance = glm::length(plain.camera.position);
  const dvec3 position = scaled.camera.position / GetParam().length - dvec3(GetParam().origin);
  EXPECT_NEAR(glm::length(position - plain.camera.position), 0, 1e-4 * distance);
  EXPECT_NEAR(scaled.transfer_function.hi / GetParam().value - GetParam().zero, plain.transfer_function.hi, 1e-6);
  if (GetParam().zero != 0) return;  // colours depend on whether values have both signs
  // Its densities have four decimal digits.
  expect_same(draw(plain_, plain, KernelKind::moments, {}), draw(scaled_, scaled, KernelKind::moments, {}),
              std::max(5 * tolerance(), 2e-4));
}

// A fill value that nobody knows as one, or any value far from all others, does not cost these their precision.
TEST_F(RendererTestBuilt, OneFarValueLeavesTheOthersAsTheyWere) {
  constexpr std::array<Way, 2> ways{Way::gl, Way::processor};
  const auto errors = [&](std::optional<double> first) {
    build(plain_, ScaledMesh({}, first));
    const Image exact = exact_picture({}, first);
    std::array<double, ways.size()> result{};
    std::ranges::transform(ways, result.begin(), [&](Way way) {
      const Image drawn = draw(plain_, scene_in({}), KernelKind::moments, {.tolerance_percent = 0}, way);
      return compare_images(drawn, exact).value().rmse;
    });
    return result;
  };
  const auto usual = errors(std::nullopt);
  for (const double far : {1e3, 1e6, 1e8, 9.969209968386869e36, -1e30}) {
    const auto error = errors(far);
    for (std::size_t i = 0; i < ways.size(); ++i) EXPECT_LE(error[i], 1.1 * usual[i]) << far << ", way " << i;
  }
}

TEST_P(RendererTestScales, DoNotChangeTheExactPicture) {
  expect_same(exact_picture({}), exact_picture(GetParam()), 1e-6);
}

INSTANTIATE_TEST_SUITE_P(Sizes, RendererTestScales,
                         testing::ValuesIn(sample_of<Scales>(
                             {Scales{1e-30, 1}, Scales{1e30, 1}, Scales{300, 1}, Scales{1, 1e-30}, Scales{1, 1e30},
                              Scales{0x1p-100, 0x1p100}, Scales{1, 1, 1e6, 0}, Scales{1, 1, 0, 1e5},
                              Scales{1e20, 1e-20, -1e6, -1e5},  // the sample ends here
                              Scales{1e-15, 1}, Scales{1e-5, 1}, Scales{1e3, 1}, Scales{1e7, 1}, Scales{1e14, 1},
                              Scales{1e-30, 1e30}, Scales{1e30, 1e-30}, Scales{0x1p100, 0x1p-100}},
                             9)));

}  // namespace
}  // namespace splatvol::test
