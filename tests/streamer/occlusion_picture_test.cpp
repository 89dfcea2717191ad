// From file to picture: leaving out nodes behind an opaque front does not change the picture.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <fstream>
#include <limits>
#include <optional>
#include <string>

#include "renderer/device/device.h"
#include "streamer/splats/streamer.h"
#include "tests/builder/support/built_input.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

constexpr int along_edge = 60;  // points

// Points x, y, z, a, b that fill the cube [0, 1]^3: a = x, b = y, or NaN in a ball round the middle.
void write_points(const std::string& path) {
  std::string header = fmt::format("{{'descr': '<f4', 'fortran_order': False, 'shape': ({}, 5), }}",
                                   along_edge * along_edge * along_edge);
  header.resize(117, ' ');
  std::ofstream file(path, std::ios::binary);
  file.write("\x93NUMPY\x01\x00\x76\x00", 10);
  file << header << '\n';
  for (int i = 0; i < along_edge * along_edge * along_edge; ++i) {
    const dvec3 p =
        (dvec3(i % along_edge, i / along_edge % along_edge, i / (along_edge * along_edge)) + 0.5) / double{along_edge};
    const double b = glm::length(p - 0.5) < 0.3 ? std::numeric_limits<double>::quiet_NaN() : p.y;
    for (const double value : {p.x, p.y, p.z, p.x, b}) {
      const auto single = static_cast<float>(value);
      file.write(reinterpret_cast<const char*>(&single), sizeof(single));
    }
  }
}

struct Drawn {
  Image image;
  std::uint64_t splats;
};

struct RendererTestOcclusion : testing::Test {
  static void SetUpTestSuite() {
    folder_.emplace();
    write_points(folder_->path("points.npy"));
    SourceOptions options{.columns = {"x", "y", "z", "a", "b"}};
    BuildOptions build{.connectivity = Connectivity::none};
    build_input(folder_->path("points.npy"), folder_->path("points.svol"), build, options);
    build_input("gen:mesh:cells=4e5", folder_->path("mesh.svol"));
  }
  static void TearDownTestSuite() { folder_.reset(); }

  Drawn draw(const View& view, const std::string& attribute, double extinction, bool hide) const {
    const TransferFunction function{
        0, 1, {{0, dvec3(1, 0, 0)}, {1, dvec3(0, 0.5, 1)}}, {{0, 0.6 * extinction}, {1, extinction}}};
    StreamerOptions options{.attribute = attribute, .hide = hide};
    const auto streamer =
        Streamer::open(open_file(folder_->path(attribute == "value" ? "mesh.svol" : "points.svol")).value(), options)
            .value();
    const auto renderer = make_rasterizer(Device::cpu, {.kernel = KernelKind::moments}).value();
    EXPECT_TRUE(renderer->set_transfer_function(function, streamer->units()));
    const FrameSplats& frame = *streamer->request(view, function, {.tolerance_percent = 2}).value();
    EXPECT_TRUE(renderer->set_draw_list(frame.list));
    EXPECT_TRUE(renderer->draw(view, SortMode::exact, 1));
    return {renderer->read_image().value(), frame.splats};
  }

  // Returns the share of the splats that is drawn. Checks that no pixel differs.
  double check(const View& view, const std::string& attribute, double extinction = 300) const {
    const Drawn all = draw(view, attribute, extinction, false), front = draw(view, attribute, extinction, true);
    const ImageDifference difference = compare_images(all.image, front.image).value();
    EXPECT_LT(difference.max, 1e-3);
    EXPECT_GT(difference.mean_a, 0.05) << "there is nothing to see";
    EXPECT_GT(all.splats, 1000u);
    return static_cast<double>(front.splats) / static_cast<double>(all.splats);
  }

  static Camera camera(const dvec3& eye) {
    Camera camera{.position = eye, .focal_point = dvec3(0.5)};
    return camera;
  }
  static View view(const Camera& camera) { return make_view(camera, 200, 160).value(); }

  void from_outside() const;
  void of_points_without_a_value_hides_nothing() const;
  void with_the_eye_inside() const;
  void with_a_clip_box() const;
  void in_parallel_projection() const;

  // The cube of points, and a mesh: the box [-2, 2] x [-2, 2] x [-1, 1], attribute "value"
  static inline std::optional<TempFolder> folder_;
};

void RendererTestOcclusion::from_outside() const {
  EXPECT_LT(check(view(camera({2, 1.6, 3})), "a"), 0.8);
  for (const double extinction : {15, 30, 300})
    EXPECT_LT(check(view(camera({5, 4, 8})), "value", extinction), 0.9) << extinction;
}

void RendererTestOcclusion::of_points_without_a_value_hides_nothing() const {
  EXPECT_EQ(check(view(camera({2, 1.6, 3})), "b"), 1);
}

void RendererTestOcclusion::with_the_eye_inside() const {
  Camera inside = camera({1.8, 0.2, 0.1});
  inside.focal_point = {-2, 0, 0};
  for (const double extinction : {30, 300}) EXPECT_LT(check(view(inside), "value", extinction), 0.9) << extinction;
  inside = camera({0.45, 0.55, 0.8});
  for (const char* attribute : {"a", "b"}) check(view(inside), attribute);
}

void RendererTestOcclusion::with_a_clip_box() const {
  View clipped = view(camera({5, 4, 8}));
  clipped.clip.box = Box{{-1.9, -1.8, -1}, {1.7, 1.9, 0.8}};
  EXPECT_LT(check(clipped, "value"), 1);
  clipped.clip.box = Box{{-2, -2, 0.57}, {2, 2, 0.6}};
  EXPECT_EQ(check(clipped, "value", 60), 1) << "a slab that is seen through";
}

void RendererTestOcclusion::in_parallel_projection() const {
  Camera parallel = camera({2, 1.6, 3});
  parallel.projection = Camera::Projection::orthographic;
  parallel.parallel_height = 1.5;
  EXPECT_LT(check(view(parallel), "a"), 0.8);
  parallel = camera({5, 4, 8});
  parallel.projection = Camera::Projection::orthographic;
  parallel.parallel_height = 3;
  for (const double extinction : {15, 300}) EXPECT_LT(check(view(parallel), "value", extinction), 0.9) << extinction;
}

// One test, so that the two files are made once.
TEST_F(RendererTestOcclusion, LeavesThePictureAsItIs) {
  from_outside();
  of_points_without_a_value_hides_nothing();
  with_the_eye_inside();
  with_a_clip_box();
  in_parallel_projection();
}

}  // namespace
}  // namespace splatvol::test
