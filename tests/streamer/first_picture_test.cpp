// From a mesh to its first picture: what the camera shows, how opaque the material is, and which attribute is chosen.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <string>

#include "base/file.h"
#include "builder/pipeline/build.h"
#include "pictures/contrast.h"
#include "renderer/device/device.h"
#include "streamer/first/default_scene.h"
#include "streamer/first/first_attribute.h"
#include "streamer/splats/streamer.h"
#include "tests/builder/support/piece_source.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

using Shape = std::function<dvec3(const dvec3&)>;         // of [0, 1]^3
using Field = std::function<double(const dvec3& place)>;  // of the shape's positions

using Cells = std::array<std::uint32_t, 3>;

// A mesh with attributes of these names.
class NamedSource final : public test::PieceSource {
 public:
  NamedSource(std::vector<std::string> names, Piece piece)
      : PieceSource({std::move(piece)}), names_(std::move(names)) {}
  const std::vector<std::string>& attributes() const override { return names_; }

 private:
  std::vector<std::string> names_;
};

double seven(const dvec3&) { return 7; }

struct RendererTestFirstPicture : FolderTest {
  // Builds a volume of a lattice of cells, bent to a shape, and makes its first scene.
  Scene scene_of(const Cells& cells, const Shape& shape, std::vector<std::pair<std::string, Field>> fields,
                 const FirstPicture& picture = {}, int up = -1) {
    const Mesh mesh = lattice(cells, shape);
    Piece piece;
    piece.points = mesh.points;
    piece.tetrahedra = mesh.tetrahedra;
    std::vector<std::string> names;
    for (const auto& [name, field] : fields) names.push_back(name), piece.values.push_back(sample(mesh, field));
    build(std::move(names), std::move(piece), up);
    return scene_of(picture);
  }
  void build(std::vector<std::string> names, Piece piece, int up = -1, bool keep_cells = false) const {
    NamedSource source(std::move(names), std::move(piece));
    BuildOptions options{.join_attributes = false, .up = up, .keep_cells = keep_cells};
    EXPECT_EQ(message_of(build_volume(source, file_, options, [](const char*, double) {})), "");
  }
  Scene scene_of(const FirstPicture& picture, const std::string& attribute = "") const {
    const auto scene = default_scene(*format::Volume::open(open_file(file_).value()).value(), attribute, picture);
    EXPECT_TRUE(scene) << scene.error().message;
    return scene.value_or(Scene{});
  }

  Image draw(const Scene& scene) const {
    const auto streamer = Streamer::open(open_file(file_).value(), {.attribute = scene.attribute}).value();
    const auto renderer = make_rasterizer(Device::cpu, {.kernel = KernelKind::moments}).value();
    EXPECT_TRUE(renderer->set_transfer_function(scene.transfer_function, streamer->units()));
    const View view = make_view(scene).value();
    const FrameSplats& frame = *streamer->request(view, scene.transfer_function, {}).value();
    EXPECT_TRUE(renderer->set_draw_list(frame.list));
    EXPECT_TRUE(renderer->draw(view, SortMode::exact, 1));
    return renderer->read_image().value();
  }

  const std::string file_ = path("v.svol");
};

// Opacities of the pixels that show material, ascending.
std::vector<float> opacities(const Image& image) {
  std::vector<float> list;
  for (const vec4& pixel : image.pixels)
    if (pixel.a > 0.03f) list.push_back(pixel.a);
  std::ranges::sort(list);
  return list;
}

// Shares of the picture that are empty at its four sides.
struct Margins {
  double least, sides, ends;  // the least; left and right; over and under
};

Margins margins(const Image& image) {
  int left = image.width, right = -1, top = image.height, bottom = -1;
  for (int y = 0; y < image.height; ++y)
    for (int x = 0; x < image.width; ++x)
      if (image.at(x, y).a > 0.03f)
        left = std::min(left, x), right = std::max(right, x), top = std::min(top, y), bottom = std::max(bottom, y);
  const double l = double(left) / image.width, r = double(image.width - 1 - right) / image.width;
  const double t = double(top) / image.height, b = double(image.height - 1 - bottom) / image.height;
  return {std::min({l, r, t, b}), l + r, t + b};
}

Shape box(const dvec3& origin, const dvec3& extent) {
  return [=](const dvec3& p) { return origin + extent * p; };
}

// A thin tube along a helix in a box of length 1.
dvec3 helix(const dvec3& p) {
  const double turn = 3 * std::numbers::pi * p.z, round = 2 * std::numbers::pi * p.y, radius = 0.006 * (0.05 + p.x);
  const dvec3 out(std::cos(turn), std::sin(turn), 0);
  return 0.4 * out + dvec3(0, 0, p.z) + radius * (std::cos(round) * out + dvec3(0, 0, std::sin(round)));
}

TEST_F(RendererTestFirstPicture, FillsThePictureButForItsMargin) {
  const std::vector<std::pair<Cells, Shape>> shapes = {{{12, 12, 12}, box(dvec3(0), dvec3(1))},
                                                       {{24, 6, 6}, box(dvec3(1e5, -1e5, 0), dvec3(1e-2, 1e-3, 1e-3))},
                                                       {{3, 24, 24}, box(dvec3(0), dvec3(1, 1e3, 1e3))},
                                                       {{3, 8, 200}, helix}};
  for (const auto& [cells, shape] : shapes)
    for (const auto& [width, height] : {std::pair{300, 200}, std::pair{180, 270}})
      for (const int up : {1, 2}) {
        const Scene scene = scene_of(cells, shape, {{"a", seven}}, {width, height}, up);
        EXPECT_EQ(scene.camera.up[up], 1);
        const Margins found = margins(draw(scene));
        EXPECT_GT(found.least, 0.035) << width << " up " << up;
        const bool solid = cells[2] < 100;  // the corners of the helix's box are empty
        EXPECT_LT(std::min(found.sides, found.ends), solid ? 0.2 : 0.4) << width << " up " << up;
      }
}

TEST_F(RendererTestFirstPicture, TheMaterialIsNeitherFogNorAWall) {
  for (const double thickness : {1.0, 0.1, 1e-3})
    for (const double scale : {1e-5, 1.0, 1e5}) {
      const Shape slab = box(dvec3(0), scale * dvec3(1, 1, thickness));
      for (const dvec3& background : {dvec3(0), dvec3(1)}) {
        const Scene scene =
            scene_of({16, 16, thickness < 0.5 ? 2u : 16u}, slab, {{"a", seven}}, {200, 160, background});
        const auto found = opacities(draw(scene));
        ASSERT_GT(found.size(), 2000u);
        const float median = found[found.size() / 2];
        EXPECT_GT(median, 0.5f) << thickness << " x " << scale;
        EXPECT_LT(median, 0.92f) << thickness << " x " << scale;
      }
    }
}

// A range far narrower than its distance from zero is a range, unless it is the rounding of single precision.
TEST_F(RendererTestFirstPicture, ANarrowRangeIsShown) {
  const auto wave = [](const dvec3& p) { return 1e-3 * std::sin(5 * p.x) * std::cos(4 * p.y + p.z); };
  const Scene scene =
      scene_of({12, 12, 12}, box(dvec3(0), dvec3(1)), {{"p", [&](const dvec3& p) { return 101325 + wave(p); }}});
  EXPECT_GT(scene.transfer_function.lo, 101325 - 1.1e-3);
  EXPECT_LT(scene.transfer_function.hi, 101325 + 1.1e-3);
  EXPECT_GT(scene.transfer_function.hi - scene.transfer_function.lo, 1e-3);
  const auto rounded = [&](const dvec3& p) { return double{static_cast<float>(101325 + 10 * wave(p))}; };
  EXPECT_GT(scene_of({12, 12, 12}, box(dvec3(0), dvec3(1)), {{"p", rounded}}).transfer_function.hi, 101330);
}

TEST_F(RendererTestFirstPicture, AThinVesselIsSeen) {
  const Scene scene = scene_of({4, 12, 300}, helix, {{"p", [](const dvec3& p) { return 100 - 50 * p.z; }}}, {400, 400});
  const auto found = opacities(draw(scene));
  ASSERT_GT(found.size(), 1000u);
  EXPECT_GT(found[found.size() / 2], 0.35f);
}

// Shells round a ball, each larger than the one inside by the same factor.
dvec3 shells(const dvec3& p) {
  const double radius = std::exp(std::log(1e3) * p.x);
  const double theta = std::numbers::pi * (0.02 + 0.96 * p.y), phi = 2 * std::numbers::pi * p.z;
  return radius * dvec3(std::sin(theta) * std::cos(phi), std::cos(theta), std::sin(theta) * std::sin(phi));
}

TEST_F(RendererTestFirstPicture, TheFarFieldVanishes) {
  const auto potential = [](const dvec3& p) { return 101325 + 500 * p.x / std::pow(glm::length(p), 3); };
  const Scene scene = scene_of({50, 20, 30}, shells, {{"p", potential}}, {200, 200});
  EXPECT_LT(glm::length(scene.camera.position - scene.camera.focal_point), 60);  // of a domain of 2000
  const TransferFunction& function = scene.transfer_function;
  EXPECT_NEAR(0.5 * (function.lo + function.hi), 101325, 20);  // diverging round the free stream
  EXPECT_EQ(function.extinction(101325), 0);
  const Image image = draw(scene);
  for (const int x : {0, 199})
    for (const int y : {0, 199}) EXPECT_LT(image.at(x, y).a, 0.1);
  EXPECT_GT(opacities(image).size(), 2000u);
}

// Of a mesh without values, the shape is worth a look.
TEST_F(RendererTestFirstPicture, VolumesOfCellsAreSeenAlike) {
  const auto volume_of_cell = [](const dvec3& p) { return std::exp(3 * p.x); };
  for (const char* name : {"cell_volume", "T"}) {
    const TransferFunction function =
        scene_of({9, 9, 9}, box(dvec3(0), dvec3(1)), {{name, volume_of_cell}}).transfer_function;
    EXPECT_EQ(function.extinction_at(0) == function.extinction_at(1), name == std::string("cell_volume"));
    EXPECT_GT(function.extinction_at(1), 0);
  }
}

// Its splats reach less far than its corners.
TEST_F(RendererTestFirstPicture, ATetrahedronIsInItsOutline) {
  Piece piece;
  piece.points = {{0, 0, 0}, {2, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  piece.tetrahedra = {{0, 1, 2, 3}};
  piece.values = {{1, 2, 3, 4}};
  const std::vector<dvec3> corners = piece.points;
  build({"a"}, std::move(piece), -1, true);
  const Box domain = domain_of(*format::Volume::open(open_file(file_).value()).value()).value();
  EXPECT_LT(glm::length(domain.low), 1e-3);
  EXPECT_LT(glm::length(domain.high - dvec3(2, 1, 1)), 1e-3);
  const View view = make_view(scene_of(FirstPicture{})).value();
  for (const dvec3& corner : corners) {
    const dvec3 p = view.to_view(corner);
    EXPECT_LT(std::abs(p.x) * view.focal / p.z, 0.5 * view.width) << corner.x << " " << corner.y;
    EXPECT_LT(std::abs(p.y) * view.focal / p.z, 0.5 * view.height) << corner.x << " " << corner.y;
  }
}

// A sheet is seen from above. There an axis in its plane is upwards, unless the camera turns round it.
TEST_F(RendererTestFirstPicture, ASheetIsUpright) {
  const auto x = [](const dvec3& p) { return p.x; };
  const auto up_of = [&](const dvec3& extent, int up, const FirstPicture& picture = {}) {
    return scene_of({12, 12, 12}, box(dvec3(0), extent), {{"a", x}}, picture, up).camera.up;
  };
  const dvec3 y(0, 1, 0), z(0, 0, 1);
  EXPECT_EQ(up_of({2, 1, 0.01}, 2), y);
  EXPECT_EQ(up_of({2, 1, 0.01}, 1), y);
  EXPECT_EQ(up_of({2, 0.01, 1}, 1), z);
  EXPECT_EQ(up_of({0.01, 2, 1}, 0), z);
  EXPECT_EQ(up_of({2, 1, 0.1}, 2), z);
  EXPECT_EQ(up_of({2, 1, 0.01}, 2, {.turns = true}), z);
}

TEST_F(RendererTestFirstPicture, ColoursDivergeOnlyIfThereAreTwoSides) {
  const auto middle_of_colors = [](const Scene& scene) {
    const TransferFunction& f = scene.transfer_function;
    const dvec3 rgb = f.color(0.5 * (f.lo + f.hi));
    return std::max({rgb.r, rgb.g, rgb.b}) - std::min({rgb.r, rgb.g, rgb.b});
  };
  const Scene waves = scene_of({16, 16, 16}, box(dvec3(0), dvec3(1)),
                               {{"a", [](const dvec3& p) { return std::sin(6 * p.x) * std::cos(5 * p.y); }}});
  EXPECT_NEAR(waves.transfer_function.lo, -waves.transfer_function.hi, 1e-9);
  EXPECT_LT(middle_of_colors(waves), 0.01);  // grey
  const Scene ramp = scene_of({16, 16, 16}, box(dvec3(0), dvec3(1)), {{"a", [](const dvec3& p) { return 1 + p.x; }}});
  EXPECT_GT(middle_of_colors(ramp), 0.1);
  EXPECT_GT(ramp.transfer_function.extinction(1.9), ramp.transfer_function.extinction(1.2));
}

// Light comes from values that fill the picture, and not from a few dense ones.
TEST_F(RendererTestFirstPicture, ColoursAreSpreadOverWhatIsSeen) {
  const auto field = [](const dvec3& p) { return p.z < 0.1 ? 10 * p.x : 4 + p.x; };
  Scene scene = scene_of({16, 16, 20}, box(dvec3(0), dvec3(1)), {{"a", field}});
  scene.transfer_function.lo = 0, scene.transfer_function.hi = 10;
  scene.transfer_function.densities = {{0, 1}};
  scene.transfer_function.colors = {{0, {0, 0, 0.1}}, {0.5, {0, 0.5, 0.4}}, {1, {1, 1, 0}}};
  const auto volume = format::Volume::open(open_file(file_).value()).value();
  const auto ends = [&](const Scene& shown) {
    const TransferFunction f = visible_colors(*volume, shown).value();
    EXPECT_EQ(f.densities, shown.transfer_function.densities);
    return dvec2(f.value_at(f.colors.front().t), f.value_at(f.colors.back().t));
  };
  const dvec2 seen = ends(scene);
  EXPECT_LT(seen.x, 4.1);
  EXPECT_GT(seen.y, 4.9);
  EXPECT_LT(seen.y - seen.x, 8);
  scene.clip_box = Box{{-1, -1, 0.2}, {2, 2, 2}};  // not the layer
  const dvec2 clipped = ends(scene);
  EXPECT_NEAR(clipped.x, 4, 0.1);
  EXPECT_NEAR(clipped.y, 5, 0.1);
  scene.transfer_function = visible_colors(*volume, scene).value();
  EXPECT_EQ(ends(scene), clipped) << "a second time changes nothing";

  // A diverging map keeps its middle.
  scene.transfer_function.colors = {{0, {0, 0, 1}}, {0.5, {1, 1, 1}}, {1, {1, 0, 0}}};
  const dvec2 diverging = ends(scene);
  EXPECT_NEAR(diverging.x, 4, 0.1);
  EXPECT_NEAR(diverging.x + diverging.y, 10, 1e-9);

  // By the opacity of another attribute.
  scene.opacity = SceneOpacity{"a", {.lo = 4.4, .hi = 4.6, .colors = {{0, dvec3(1)}}, .densities = {{0, 0}, {1, 1}}}};
  EXPECT_GT(ends(scene).x, 4.35);

  scene.camera.focal_point = scene.camera.position + dvec3(0, 0, 100);  // nothing is in the picture
  EXPECT_EQ(visible_colors(*volume, scene).value(), scene.transfer_function);
}

TEST_F(RendererTestFirstPicture, OutliersDoNotFlattenTheRest) {
  const auto field = [](const dvec3& p) { return p == dvec3(0.5) ? 200 : p == dvec3(0.25) ? -150 : 5 + p.x; };
  const Scene scene = scene_of({16, 16, 16}, box(dvec3(0), dvec3(1)), {{"a", field}});
  EXPECT_GT(scene.transfer_function.lo, -5);
  EXPECT_LT(scene.transfer_function.hi, 15);
}

TEST_F(RendererTestFirstPicture, ChoosesAQuantityAndOneCamera) {
  int count = 0;
  const auto number = [&](const dvec3&) { return ++count; };
  const auto none = [](const dvec3&) { return std::nan(""); };
  const auto x = [](const dvec3& p) { return p.x; };
  const auto label = [](const dvec3& p) { return std::floor(3 * p.x); };
  const auto hot = [](const dvec3& p) { return std::exp(-40 * glm::dot(p - 0.3, p - 0.3)); };
  const auto chosen = [&](std::vector<std::pair<std::string, Field>> fields) {
    return scene_of({8, 8, 8}, box(dvec3(0), dvec3(1)), std::move(fields)).attribute;
  };
  EXPECT_EQ(chosen({{"none", none}, {"GlobalIds", number}, {"c", seven}, {"label", label}, {"T", x}}), "T");
  EXPECT_EQ(chosen({{"T", x}, {"U", x}, {"U[0]", x}, {"U[1]", x}}), "U");
  EXPECT_EQ(chosen({{"T", x}, {"p_rgh", x}, {"U", x}, {"U[0]", x}}), "p_rgh");
  EXPECT_EQ(chosen({{"Kid", x}, {"Pressure", x}}), "Pressure");
  EXPECT_EQ(chosen({{"c", seven}, {"ids", number}}), "ids");
  EXPECT_EQ(chosen({{"c", seven}, {"none", none}}), "c");
  EXPECT_EQ(chosen({{"p", hot}, {"T", x}}), "p");
  EXPECT_EQ(scene_of({}, "T").camera, scene_of({}, "p").camera);
  EXPECT_EQ(scene_to_json(scene_of({}, "T")), scene_to_json(scene_of({}, "T")));
}

// All labels are as dense, and 0 stands for none.
TEST_F(RendererTestFirstPicture, LabelsAreSeenAlike) {
  for (const double first : {-2.0, 0.0, 1.0, 7.0}) {
    const auto label = [&](const dvec3& p) { return first + std::floor(2.9999 * p.x); };
    const TransferFunction function =
        scene_of({9, 9, 9}, box(dvec3(0), dvec3(1)), {{"material", label}}).transfer_function;
    EXPECT_EQ(function.lo, first);
    EXPECT_EQ(function.hi, first + 2);
    const double density = function.extinction_at(first == -2 ? 0 : 1);
    EXPECT_GT(density, 0);
    for (const double t : {0.0, 0.5, 1.0})
      EXPECT_EQ(function.extinction_at(t), first + 2 * t == 0 ? 0 : density) << first << " " << t;
  }
}

// Those of cells are averaged where two meet.
TEST_F(RendererTestFirstPicture, LabelsWithMeansBetweenThemAreSeenAlike) {
  const auto label = [](const dvec3& p) { return p.x < 0.45 ? 1 : p.x < 0.55 ? 1.5 : 2; };
  const TransferFunction function = scene_of({8, 8, 8}, box(dvec3(0), dvec3(1)), {{"m", label}}).transfer_function;
  EXPECT_EQ(function.extinction(1), function.extinction(2));
  EXPECT_GT(function.extinction(1), 0);
  const auto front = [](const dvec3& p) { return std::clamp(3 * p.x - 1, 0.0, 1.0); };
  EXPECT_EQ(
      scene_of({8, 8, 8}, box(dvec3(0), dvec3(1)), {{"T", front}, {"q", [](const dvec3& p) { return p.y; }}}).attribute,
      "q");
}

double radius_of(const dvec3& p) { return glm::length(p - 0.5); }

TEST_F(RendererTestFirstPicture, ValuesThatSpanDecadesGetALogarithmicAxis) {
  const Shape unit = box(dvec3(0), dvec3(1));
  const auto axis_of = [&](const Field& field) {
    return scene_of({20, 20, 20}, unit, {{"a", field}}).transfer_function;
  };
  for (const double scale : {1e-30, 1.0, 1e48}) {
    const TransferFunction f =
        axis_of([&](const dvec3& p) { return scale * std::pow(10, 3 - 9 * radius_of(p) / 0.87); });
    EXPECT_EQ(f.axis, ValueAxis::log);
    EXPECT_GT(f.lo, 1e-7 * scale);
    EXPECT_LT(f.lo, 1e-4 * scale);
    EXPECT_GT(f.hi, 0.1 * scale);
    EXPECT_EQ(f.extinction(f.lo), 0);
    EXPECT_GT(f.extinction(f.hi), 5 * f.extinction(std::sqrt(f.lo * f.hi)));
  }
  // Zeros and some errors of rounding below 0 change nothing. Means of 0 are stored with an error of rounding, too.
  const TransferFunction cut = axis_of([](const dvec3& p) {
    const double r = radius_of(p);
    return r > 0.6 ? 0 : p == dvec3(0.5) ? -1e-12 : std::pow(10, -8 * r);
  });
  EXPECT_EQ(cut.axis, ValueAxis::log);
  EXPECT_GT(cut.lo, 1e-10);
  EXPECT_GT(cut.hi, 0.01);
  // Noise of 0 and 1 round a body, as in images of bytes. Only means lie between.
  int count = 0;
  const TransferFunction bytes = axis_of([&](const dvec3& p) {
    const double noise = ++count % 31 == 0 ? 1 : 0;
    return std::max(noise, std::round(255 - 900 * radius_of(p + 0.03 * dvec3(p.y, p.z, 1))));
  });
  EXPECT_EQ(bytes.axis, ValueAxis::linear);
  const TransferFunction poles = axis_of([](const dvec3& p) {
    return std::pow(glm::length(p - dvec3(0.3, 0.5, 0.5)) + 0.003, -6) -
           std::pow(glm::length(p - dvec3(0.7, 0.5, 0.5)) + 0.003, -6);
  });
  EXPECT_EQ(poles.axis, ValueAxis::asinh);
  EXPECT_NEAR(poles.lo / poles.hi, -1, 1e-6);
  EXPECT_GT(poles.extinction(poles.hi), poles.extinction(0));

  // No decades: a smooth field, one of two values, and a wall layer that fills no volume.
  EXPECT_EQ(axis_of([](const dvec3& p) { return p.x; }).axis, ValueAxis::linear);
  EXPECT_EQ(axis_of([](const dvec3& p) { return std::sin(7 * p.x); }).axis, ValueAxis::linear);
  EXPECT_EQ(axis_of([](const dvec3& p) { return 1 / (1 + std::exp(60 * (p.z - 0.5))); }).axis, ValueAxis::linear);
  // What a solver leaves of one of two fluids in the other is an error.
  EXPECT_EQ(axis_of([](const dvec3& p) { return p.x < 0.3 ? 1 : std::pow(10, -4 - 6 * p.x); }).axis, ValueAxis::linear);
  const Shape graded = [](const dvec3& p) { return dvec3(p.x, p.y, p.z == 0 ? 0 : std::pow(1e-9, 1 - p.z)); };
  const Scene wall = scene_of({10, 10, 60}, graded, {{"U", [](const dvec3& p) { return std::tanh(20 * p.z); }}});
  EXPECT_EQ(wall.transfer_function.axis, ValueAxis::linear);
}

TEST_F(RendererTestFirstPicture, NineDecadesOfCellSizeAreSeen) {
  const auto grade = [](double t) { return t == 0 ? 0 : std::pow(1e-9, 1 - t); };
  const Shape corner = [&](const dvec3& p) { return dvec3(grade(p.x), grade(p.y), grade(p.z)); };
  const auto decade = [](const dvec3& p) { return std::log10(glm::length(p) + 1e-10); };
  const auto wave = [&](const dvec3& p) { return std::cos(2 * decade(p)); };
  for (const Field& field : {Field(decade), Field(wave)}) {
    const Image image = draw(scene_of({27, 27, 27}, corner, {{"T", field}}, {200, 200}));
    const auto found = opacities(image);
    ASSERT_GT(found.size(), 8000u);  // a fifth of the picture
    EXPECT_GT(found[found.size() * 3 / 4], 0.2f);
    double brightness = 0;
    for (const vec4& pixel : image.pixels) brightness += luminance(dvec3(pixel)) / static_cast<double>(found.size());
    EXPECT_GT(brightness, 0.02);
  }
}

TEST_F(RendererTestFirstPicture, AWakeIsInThePictureToo) {
  // The pressure varies round the origin of a long domain; the wake is behind it, beyond what the pressure shows.
  const auto pressure = [](const dvec3& p) { return 101325 + 900 * std::exp(-glm::dot(p, p)); };
  const auto wake = [](const dvec3& p) { return p.x < 0 ? 0 : std::exp(-4 * (p.y * p.y + p.z * p.z)); };
  const Shape domain = box(dvec3(-20), dvec3(40));
  const auto reach = [&](const Scene& scene) {
    const View view = make_view(scene).value();
    double last = 0;
    for (double x = 0; x < 20; x += 0.1) {
      const dvec3 p = view.to_view({x, 0, 0});
      if (std::abs(p.x) * view.focal < 0.5 * view.width * p.z) last = x;
    }
    return last;
  };
  const Scene alone = scene_of({60, 60, 60}, domain, {{"p", pressure}}, {200, 200});
  const Scene both = scene_of({60, 60, 60}, domain, {{"p", pressure}, {"k", wake}}, {200, 200});
  EXPECT_EQ(both.attribute, "p");
  EXPECT_EQ(scene_of({200, 200}, "k").camera, both.camera);
  EXPECT_GT(reach(both), 1.3 * reach(alone));
  // A quantity that varies everywhere does not count.
  const auto noise = [](const dvec3& p) { return std::sin(3 * p.x) * std::sin(4 * p.y) * std::sin(5 * p.z); };
  const Scene filled = scene_of({60, 60, 60}, domain, {{"p", pressure}, {"T", noise}}, {200, 200});
  EXPECT_EQ(filled.camera, alone.camera);
  // What the pressure shows is no dot.
  const auto distance = [](const Scene& scene) {
    return glm::length(scene.camera.position - scene.camera.focal_point);
  };
  EXPECT_LT(distance(both), 2.5 * distance(alone));
}

TEST_F(RendererTestFirstPicture, ThinMaterialThatAddsUpIsNotCropped) {
  // A dense core in a wide halo, which is thin but deep, in a large domain.
  const auto halo = [](const dvec3& p) {
    const double r = glm::length(p);
    return 101325 + 900 * std::exp(-r * r) + 250 * std::exp(-r * r / 18);
  };
  const Shape domain = box(dvec3(-25), dvec3(50));
  const Image image = draw(scene_of({50, 50, 50}, domain, {{"p", halo}}, {200, 200}));
  float border = 0;
  for (int i = 0; i < 200; ++i)
    border = std::max({border, image.at(i, 0).a, image.at(i, 199).a, image.at(0, i).a, image.at(199, i).a});
  EXPECT_LT(border, 0.25f);
  EXPECT_GT(opacities(image).size(), 4000u);
}

TEST_F(RendererTestFirstPicture, FramesOneOfTwoFarClumps) {
  const Shape clumps = [](const dvec3& p) { return p.x < 0.5 ? p : p + dvec3(1e8, 0, 0); };
  const auto field = [](const dvec3& p) { return p.x > 1e7 ? 0.5 : std::sin(9 * p.y) * std::cos(8 * p.z); };
  const Scene scene = scene_of({24, 24, 24}, clumps, {{"a", field}}, {200, 200});
  EXPECT_LT(glm::length(scene.camera.position), 100);
  EXPECT_LT(scene.transfer_function.hi, 2);
  EXPECT_GT(opacities(draw(scene)).size(), 5000u);
}

TEST_F(RendererTestFirstPicture, ValuesFarOutsideOfThePictureDoNotDecide) {
  const auto spot = [](const dvec3& p) { return 101325 + 900 * std::exp(-40 * glm::dot(p - 0.1, p - 0.1)); };
  const auto elsewhere = [](const dvec3& p) {
    return 300 + 0.5 * std::sin(20 * p.x) + 900 * std::exp(-90 * glm::dot(p - 0.9, p - 0.9));
  };
  scene_of({30, 30, 30}, box(dvec3(0), dvec3(1)), {{"p", spot}, {"T", elsewhere}}, {200, 200});
  const Scene scene = scene_of({200, 200}, "T");
  EXPECT_GT(opacities(draw(scene)).size(), 4000u);
}

TEST_F(RendererTestFirstPicture, StaysInThePictureAsItTurns) {
  Scene scene = scene_of({24, 6, 6}, box(dvec3(0), dvec3(4, 1, 1)), {{"a", seven}}, {200, 200, dvec3(0), true});
  const dvec3 center = scene.camera.focal_point;
  EXPECT_LT(glm::length(center - dvec3(2, 0.5, 0.5)), 0.05);
  for (int i = 0; i < 8; ++i) {
    EXPECT_GT(margins(draw(scene)).least, 0.03) << i;
    const glm::dquat turn = glm::angleAxis(std::numbers::pi / 4, scene.camera.up);
    scene.camera.position = center + turn * (scene.camera.position - center);
  }
}

}  // namespace
}  // namespace splatvol::test
