#include "scene/scene.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include "base/json.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

using nlohmann::json;
using namespace ::testing;

json valid_scene() {
  return json::parse(R"({
    "camera": {"position": [1, 2, 3], "focal_point": [0, 0, 0], "up": [0, 1, 0], "vertical_fov_degrees": 40},
    "image": {"width": 64, "height": 48},
    "attribute": "p",
    "transfer_function": {"domain": [-1, 3], "colors": [[0, 0, 0.5, 1], [1, 1, 1, 1]],
                          "density": [[0, 0], [0.5, 1], [0.5, 4], [1, 2]]}})");
}

/// Returns the valid scene with another value at a JSON pointer; without `value`, with the old one removed.
std::string changed(const std::string& pointer, const json& value = json::value_t::discarded) {
  json scene = valid_scene();
  if (value.is_discarded())
    scene = scene.patch({{{"op", "remove"}, {"path", pointer}}});
  else
    scene[json::json_pointer(pointer)] = value;
  return scene.dump();
}

std::string error_of(const std::string& text) {
  const auto scene = parse_scene(text);
  return scene ? "accepted" : scene.error().message;
}

TEST(ParseScene, ErrorsAreOneLineWhateverTheyQuote) {
  EXPECT_EQ(error_of(changed("/camera/odd\nname", 1)).find('\n'), std::string::npos);
  EXPECT_EQ(error_of(changed("/attribute", "a\nb\x1b[2J")).find('\x1b'), std::string::npos);
  EXPECT_NE(error_of(changed("/camera/odd\nname", 1)), "accepted");
}

TEST(ParseScene, ReadsWhatItWrites) {
  Scene scene = parse_scene(valid_scene().dump()).value();
  EXPECT_FALSE(scene.clip_box);
  scene.clip_box = Box{{-1, 0.1, 2}, {1, 0.2, 1e7}};
  scene.lighting = Lighting{0.25, 2};
  scene.background = {0.1, 0.2, 0.3};
  const auto expect_same = [](const Scene& written) {
    const auto read = value_of(parse_scene(scene_to_json(written)));
    EXPECT_EQ(read, written);
    EXPECT_EQ(make_view(read)->clip.box, written.clip_box);
    EXPECT_EQ(read_json(camera_to_json(written.camera), read_camera), written.camera);
  };
  expect_same(scene);
  Scene parallel = parse_scene(changed("/camera/parallel_height", 7.25)).value();
  parallel.camera.projection = Camera::Projection::orthographic;
  parallel.camera.vertical_fov_degrees = Camera().vertical_fov_degrees;
  expect_same(parallel);
}

TEST(ParseScene, ReadsEveryField) {
  json text = valid_scene();
  text["background"] = {0.1, 0.2, 0.3};
  text["lighting"] = {{"ambient", 0.25}, {"diffuse", 2}, {"x-specular", 1}};
  text["x-unknown"] = {{"camera", 1}};
  text["outline"] = true;
  const auto scene = value_of(parse_scene(text.dump()));
  EXPECT_EQ(scene.camera.projection, Camera::Projection::perspective);
  EXPECT_EQ(scene.camera.position, dvec3(1, 2, 3));
  EXPECT_EQ(scene.camera.focal_point, dvec3(0));
  EXPECT_EQ(scene.camera.up, dvec3(0, 1, 0));
  EXPECT_EQ(scene.camera.vertical_fov_degrees, 40);
  EXPECT_EQ(scene.width, 64);
  EXPECT_EQ(scene.height, 48);
  EXPECT_EQ(scene.attribute, "p");
  EXPECT_EQ(scene.transfer_function.lo, -1);
  EXPECT_EQ(scene.transfer_function.hi, 3);
  ASSERT_EQ(scene.transfer_function.colors.size(), 2U);
  EXPECT_EQ(scene.transfer_function.colors[0].rgb, dvec3(0, 0.5, 1));
  ASSERT_EQ(scene.transfer_function.densities.size(), 4U);
  EXPECT_EQ(scene.transfer_function.densities[2].extinction, 4);
  EXPECT_EQ(scene.background, dvec3(0.1, 0.2, 0.3));
  EXPECT_EQ(scene.lighting, (Lighting{0.25, 2}));
  EXPECT_TRUE(scene.outline);
}

TEST(ParseScene, OptionalFieldsHaveDefaults) {
  const auto scene = value_of(parse_scene(valid_scene().dump()));
  EXPECT_EQ(scene.background, dvec3(0));
  EXPECT_FALSE(scene.lighting);
}

TEST(ParseScene, NamesTheFieldNearestToAnUnknownOne) {
  const auto refuses = [](const std::string& pointer, const std::string& message) {
    EXPECT_THAT(error_of(changed(pointer, 1)), StartsWith(message)) << pointer;
  };
  refuses("/backgroud", "backgroud: no such field; the nearest is background (");
  refuses("/camera/upp", "camera.upp: no such field; the nearest is camera.up (");
  refuses("/image/Width", "image.Width: no such field; the nearest is image.width (");
  refuses("/transfer_function/colours",
          "transfer_function.colours: no such field; the nearest is "
          "transfer_function.colors (");
  EXPECT_THAT(error_of(changed("/clip_box", {{"low", {0, 0, 0}}, {"hihg", {1, 1, 1}}})),
              StartsWith("clip_box.hihg: no such field; the nearest is clip_box.high ("));
  EXPECT_THAT(error_of(changed("/lighting", {{"ambient", 1}, {"difuse", 1}})),
              StartsWith("lighting.difuse: no such field; the nearest is lighting.diffuse ("));
  EXPECT_TRUE(parse_scene(changed("/camera/x-name", "front")));
  EXPECT_THAT(error_of(changed("/outline", 1)), StartsWith("outline: "));
}

TEST(ParseScene, AnOpacityIsReadAndWrittenBack) {
  const json opacity = {{"attribute", "T"}, {"domain", {1, 100}}, {"axis", "log"}, {"factor", {{0, 0}, {0.5, 1}}}};
  const auto scene = value_of(parse_scene(changed("/opacity", opacity)));
  ASSERT_TRUE(scene.opacity);
  EXPECT_EQ(scene.opacity->attribute, "T");
  EXPECT_EQ(scene.opacity->function.extinction(10), 1);
  EXPECT_EQ(scene.opacity->function.extinction(1), 0);
  EXPECT_EQ(parse_scene(scene_to_json(scene)).value(), scene);

  const auto refuses = [&](const char* field, const json& value, const std::string& message) {
    json wrong = opacity;
    wrong[field] = value;
    EXPECT_THAT(error_of(changed("/opacity", wrong)), StartsWith(message)) << field;
  };
  refuses("attribute", "", "opacity.attribute: empty");
  refuses("domain", {2, 1}, "opacity.domain: [2, 1] is not an interval");
  refuses("domain", {-1, 1}, "opacity.domain: ");
  refuses("factor", {{0, 0}, {0.5, 1.5}}, "opacity.factor[1]: 1.5 is above 1");
  refuses("factor", {{0, -1}}, "opacity.factor[0]: ");
  refuses("factor", json::array(), "opacity.factor: not a list");
  refuses("linear_width", 1, "opacity.linear_width: only the axis asinh");
  refuses("density", {{0, 1}}, "opacity.density: no such field");
  EXPECT_THAT(error_of(changed("/opacity", 0.5)), StartsWith("opacity"));
}

TEST(ParseScene, ContoursAreReadAndWrittenBack) {
  const json coloring = {{"attribute", "T"}, {"domain", {1, 100}}, {"axis", "log"}, {"colors", {{0, 0, 0, 1}}}};
  const json contours = {{{"values", {0.25, -1}}, {"color", {1, 0.5, 0}}, {"opacity", 0.5}},
                         {{"values", {3}}, {"color_by", coloring}},
                         {{"values", {2}}, {"shown", false}},
                         {{"values", {7}}}};
  const auto scene = value_of(parse_scene(changed("/contours", contours)));
  EXPECT_EQ(scene.contours[0], (SceneContour{.values = {0.25, -1}, .color = dvec3(1, 0.5, 0), .opacity = 0.5}));
  EXPECT_EQ(scene.contours[1].color_by->attribute, "T");
  EXPECT_EQ(parse_scene(scene_to_json(scene)).value(), scene);

  // Those that are shown, by their values.
  const Contours shown = contours_of(scene);
  ASSERT_EQ(shown.surfaces.size(), 4U);
  const dvec3 color = scene.transfer_function.color(7);
  EXPECT_EQ(shown.surfaces[0], (Contour{.value = -1, .color = {1, 0.5, 0}, .opacity = 0.5}));
  EXPECT_EQ(shown.surfaces[1], (Contour{.value = 0.25, .color = {1, 0.5, 0}, .opacity = 0.5}));
  EXPECT_TRUE(shown.surfaces[2].is_colored);
  EXPECT_EQ(shown.surfaces[3], (Contour{.value = 7, .color = color, .opacity = 1}));
  EXPECT_EQ(shown.attribute, "T");
  EXPECT_EQ(shown.colors.axis, ValueAxis::log);
}

TEST(ParseScene, StreamlinesAreReadAndWrittenBack) {
  const json coloring = {{"attribute", "T"}, {"domain", {1, 100}}, {"colors", {{0, 0, 0, 1}}}};
  const json streamlines = {
      {{"vector", "U"}, {"seeds", {{"line", {{0, 0, 0}, {1, 0, 0}}}}}, {"radius", 0.5}},
      {{"vector", "U"},
       {"seeds", {{"rectangle", {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}}, {"counts", {3, 4}}}},
       {"direction", "backward"},
       {"length", 2},
       {"steps", 7},
       {"radius", 1},
       {"color", {1, 0, 0}}},
      {{"vector", "V"}, {"seeds", {{"patch", "in*"}, {"count", 9}}}, {"radius", 1}, {"color_by", coloring}},
      {{"vector", "V"}, {"seeds", {{"positions", {{1, 2, 3}}}}}, {"radius", 1}, {"shown", false}}};
  const auto scene = value_of(parse_scene(changed("/streamlines", streamlines)));
  ASSERT_EQ(scene.streamlines.size(), 4U);
  EXPECT_EQ(scene.streamlines[0],
            (SceneStreamlines{.vector = "U", .seeds = SeedLine{dvec3(0), dvec3(1, 0, 0), 20}, .radius = 0.5}));
  EXPECT_EQ(scene.streamlines[1],
            (SceneStreamlines{.vector = "U",
                              .seeds = SeedRectangle{dvec3(0), dvec3(1, 0, 0), dvec3(0, 1, 0), {3, 4}},
                              .direction = StreamlineDirection::backward,
                              .max_length = 2,
                              .max_steps = 7,
                              .color = {1, 0, 0}}));
  EXPECT_EQ(scene.streamlines[2].seeds, Seeds(SeedPatch{"in*", 9}));
  EXPECT_EQ(scene.streamlines[2].color_by->attribute, "T");
  EXPECT_EQ(scene.streamlines[3].seeds, Seeds(std::vector{dvec3(1, 2, 3)}));
  EXPECT_FALSE(scene.streamlines[3].shown);
  EXPECT_EQ(parse_scene(scene_to_json(scene)).value(), scene);
}

TEST(ParseScene, NamesTheWrongPartOfStreamlines) {
  const auto refuses = [](const std::string& part, const json& value, const std::string& message) {
    json streamlines = {{"vector", "U"}, {"seeds", {{"line", {{0, 0, 0}, {1, 0, 0}}}}}, {"radius", 1}};
    streamlines[json::json_pointer(part)] = value;
    EXPECT_THAT(error_of(changed("/streamlines", json::array({streamlines}))), StartsWith("streamlines[0]" + message));
  };
  refuses("/radius", 0, ".radius: not above 0");
  refuses("/vector", "", ".vector: empty");
  refuses("/direction", "up", ".direction: 'up' is none of");
  refuses("/length", -1, ".length: not above 0");
  refuses("/steps", 0.5, ".steps: not a whole number");
  refuses("/seed", 1, ".seed: no such field");
  refuses("/seeds", json::object(), ".seeds: give one of");
  refuses("/seeds/patch", "a", ".seeds: give one of");
  refuses("/seeds/line", {{0, 0, 0}}, ".seeds.line: not a list of 2 positions");
  refuses("/seeds/count", 0, ".seeds.count: not a whole number from 1");
  refuses("/seeds/counts", {1, 1}, ".seeds: \"counts\" is for");
  refuses("/seeds", {{"rectangle", {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}}, {"counts", {1}}}, ".seeds.counts: not a list");
  refuses("/seeds", {{"positions", json::array()}}, ".seeds.positions: not a list");
}

// Whatever is coloured by values has a scalar bar.
TEST(BarColors, AreThoseOfAllThatIsShown) {
  const json coloring = {{"attribute", "T"}, {"domain", {1, 100}}, {"colors", {{0, 0, 0, 1}}}};
  Scene scene = value_of(parse_scene(changed("/contours", {{{"values", {3}}, {"color_by", coloring}}})));
  const auto attributes = [&] {
    std::vector<std::string> names;
    for (const BarColors& bar : bar_colors_of(scene)) names.push_back(bar.attribute);
    return names;
  };
  const std::string own = scene.attribute;
  EXPECT_THAT(attributes(), ElementsAre(own, "T"));
  EXPECT_EQ(bar_colors_of(scene)[0].function.colors, scene.transfer_function.colors);
  scene.transfer_function.densities = {{0, 0}};
  EXPECT_THAT(attributes(), ElementsAre("T"));
  EXPECT_EQ(bar_colors_of(scene)[0].function.hi, 100);
  scene.surfaces = {{.boundary = "wall", .color_by = scene.contours[0].color_by}};
  EXPECT_THAT(attributes(), ElementsAre("T")) << "the same colours";
  scene.surfaces[0].color_by->function.hi = 50;
  EXPECT_THAT(attributes(), ElementsAre("T", "T"));
  scene.slices = {SceneSlice{}};
  EXPECT_THAT(attributes(), ElementsAre(own, "T", "T"));
  scene.slices[0].shown = scene.contours[0].shown = scene.surfaces[0].shown = false;
  EXPECT_THAT(attributes(), ElementsAre(own)) << "nothing";
  scene.contours.push_back({.values = {1}, .color = dvec3(1)});
  scene.surfaces[0].shown = true;
  EXPECT_THAT(attributes(), ElementsAre("T")) << "no values colour that contour";
  scene.contours[1].color.reset();
  EXPECT_THAT(attributes(), ElementsAre(own, "T"));
}

TEST(ParseScene, NamesTheWrongPartOfAContour) {
  const auto refuses = [](const json& contours, const std::string& message) {
    EXPECT_THAT(error_of(changed("/contours", contours)), StartsWith(message));
  };
  refuses(1, "contours: not a list");
  refuses({{{"values", json::array()}}}, "contours[0].values: not a list of values");
  refuses({{{"values", 3}}}, "contours[0].values: not a list of values");
  refuses({{{"values", {1, "x"}}}}, "contours[0].values[1]: not a number");
  refuses({{{"value", {1}}}}, "contours[0].value: no such field; the nearest is contours[0].values");
  refuses({{{"values", {1}}, {"opacity", 2}}}, "contours[0].opacity: 2 is outside [0, 1]");
  refuses({{{"values", {1}}, {"shown", 2}}}, "contours[0].shown: neither");
  refuses({{{"values", {1}}, {"color", {1, -1, 1}}}}, "contours[0].color: negative");
  json coloring = {{"attribute", "T"}, {"domain", {1, 100}}, {"colors", {{0, 0, 0, 1}}}};
  refuses({{{"values", {1}}, {"color", {1, 1, 1}}, {"color_by", coloring}}}, "contours[0]: give \"color\" or");
  json other = coloring;
  other["domain"] = {2, 3};
  refuses({{{"values", {1}}, {"color_by", coloring}}, {{"values", {2}}, {"color_by", other}}}, "contours: two differ");
  other["domain"] = {3, 3};
  refuses({{{"values", {1}}, {"color_by", other}}}, "contours[0].color_by.domain: [3, 3] is not an interval");
  refuses({{{"values", {1, 2}}}, {{"values", {2}}}}, "contours: the value 2 is given twice");
  refuses({{{"values", json(std::vector<int>(257, 0))}}}, "contours: 257 values; at most 256");

  Scene scene = parse_scene(valid_scene().dump()).value();
  scene.contours = {{.values = {std::nan("")}}};
  EXPECT_EQ(make_view(scene).error().message, "contours: a value is not finite");
}

TEST(ParseScene, SlicesAndClipPlanesAreReadAndWrittenBack) {
  json text = json::parse(
      changed("/slices",
              {{{"point", {1, 2, 3}}, {"normal", {0, 0, 2}}},
               {{"point", {1e7, 0, 0}}, {"normal", {1e-200, 2e-200, -1e-200}}, {"opacity", 0.25}, {"shown", false}}}));
  text["clip_planes"] = {{{"point", {0, 0, 0}}, {"normal", {3, 0, 4}}},
                         {{"point", {0, 1, 0}}, {"normal", {0, 1, 0}}, {"active", false}}};
  const auto scene = value_of(parse_scene(text.dump()));
  const std::vector<SceneSlice> slices{
      {.point = {1, 2, 3}, .normal = {0, 0, 2}},
      {.point = {1e7, 0, 0}, .normal = {1e-200, 2e-200, -1e-200}, .opacity = 0.25, .shown = false}};
  const std::vector<SceneClipPlane> planes{{.point = dvec3(0), .normal = {3, 0, 4}},
                                           {.point = {0, 1, 0}, .normal = {0, 1, 0}, .active = false}};
  EXPECT_EQ(scene.slices, slices);
  EXPECT_EQ(scene.clip_planes, planes);
  const auto again = parse_scene(scene_to_json(scene)).value();
  EXPECT_EQ(again.slices, slices);
  EXPECT_EQ(again.clip_planes, planes);

  // Views have those that count, with normals of length 1.
  View view = make_view(again).value();
  ASSERT_EQ(view.slices.size(), 1U);
  EXPECT_EQ(view.slices[0].plane, (Plane{{1, 2, 3}, {0, 0, 1}}));
  ASSERT_EQ(view.clip.planes.size(), 1U);
  EXPECT_NEAR(glm::length(view.clip.planes[0].normal - dvec3(0.6, 0, 0.8)), 0, 1e-15);
  Scene shown = again;
  shown.slices[1].shown = true;
  view = make_view(shown).value();
  ASSERT_EQ(view.slices.size(), 2U);
  EXPECT_NEAR(glm::length(view.slices[1].plane.normal), 1, 1e-15);
  shown.slices[1].opacity = 0;
  EXPECT_EQ(make_view(shown)->slices.size(), 1U) << "nothing of it is seen";
}

TEST(ParseScene, NamesTheWrongPartOfAPlane) {
  const json point = {0, 0, 0}, normal = {0, 0, 1};
  for (const std::string name : {"slices", "clip_planes"}) {
    const auto refuses = [&](const json& value, const std::string& message) {
      EXPECT_THAT(error_of(changed("/" + name, value)), StartsWith(name + message));
    };
    refuses({{{"point", point}, {"normal", {0, 0, 0}}}}, "[0]: the normal has no direction; give one that is not");
    refuses({{{"point", point}}}, "[0].normal: missing");
    refuses({{{"normal", normal}}}, "[0].point: missing");
    refuses({{{"point", point}, {"normal", normal}}, 1}, "[1]: not an object");
    refuses({{{"point", {0, 0}}, {"normal", normal}}}, "[0].point: not a list of 3 numbers");
    refuses({{{"point", {0, 0, "nan"}}, {"normal", normal}}}, "[0].point[2]: not a number");
    refuses({{{"point", {0, 0, 2e100}}, {"normal", normal}}}, "[0].point[2]: beyond");
    refuses({{{"point", point}, {"normal", normal}, {"pint", 1}}}, "[0].pint: no such field");
    refuses({{"point", point}, {"normal", normal}}, ": not a list");
    refuses(json(std::vector<json>(65, {{"point", point}, {"normal", normal}})), ": 65 planes; at most 64");
  }
  const auto slice = [&](const char* field, const json& value) {
    return error_of(changed("/slices", {{{"point", point}, {"normal", normal}, {field, value}}}));
  };
  EXPECT_THAT(slice("opacity", 1.5), StartsWith("slices[0].opacity: 1.5 is outside [0, 1]"));
  EXPECT_THAT(slice("shown", 1), StartsWith("slices[0].shown: neither true nor false"));
  EXPECT_THAT(slice("active", true), StartsWith("slices[0].active: no such field"));
  EXPECT_THAT(error_of(changed("/clip_planes", {{{"point", point}, {"normal", normal}, {"active", 0}}})),
              StartsWith("clip_planes[0].active: neither true nor false"));
}

TEST(ParseScene, SurfacesAreReadAndWrittenBack) {
  const json coloring = {{"attribute", "T"}, {"domain", {0, 4}}, {"colors", {{0, 0, 0, 1}, {1, 1, 0, 0}}}};
  SceneColoring by_temperature{"T", {.colors = {{0, dvec3(0, 0, 1)}, {1, dvec3(1, 0, 0)}}, .densities = {{0, 1}}}};
  by_temperature.function.lo = 0, by_temperature.function.hi = 4;
  const auto scene = value_of(parse_scene(
      changed("/surfaces",
              {{{"file", "a.stl"}},
               {{"file", "/b/c.obj"}, {"color", {1, 0.5, 0}}, {"opacity", 0.25}, {"shown", false}, {"edges", true}},
               {{"boundary", "wing*"}, {"opacity", 0.5}, {"color_by", coloring}},
               {{"boundary", "in"}, {"near_side", "translucent"}},
               {{"boundary", "out"}, {"near_side", "hidden"}}})));
  const std::vector<SceneSurface> expected{
      {.file = "a.stl"},
      {.file = "/b/c.obj", .color = {1, 0.5, 0}, .opacity = 0.25, .shown = false, .edges = true},
      {.opacity = 0.5, .boundary = "wing*", .color_by = by_temperature},
      {.boundary = "in", .near_side = NearSide::translucent},
      {.boundary = "out", .near_side = NearSide::hidden}};
  EXPECT_EQ(scene.surfaces, expected);
  EXPECT_EQ(parse_scene(scene_to_json(scene))->surfaces, expected);
  EXPECT_TRUE(parse_scene(valid_scene().dump())->surfaces.empty());
}

TEST(ParseScene, ItsUseIsReadAndWrittenBack) {
  json document = valid_scene();
  EXPECT_EQ(parse_used_scene(document.dump())->use, SceneUse());
  document.update({{"file", "a.svol"}, {"step", 3}, {"tolerance", 0.5}, {"kernel", "octant"}});
  const auto used = value_of(parse_used_scene(document.dump()));
  EXPECT_EQ(used.use, (SceneUse{.file = "a.svol",
                                .step = 3,
                                .quality = {.tolerance_percent = 0.5},
                                .drawing = {.kernel = KernelKind::octant}}));
  document.erase("tolerance");
  document["exact"] = true;
  const UsedScene exact = parse_used_scene(document.dump()).value();
  EXPECT_TRUE(exact.use.quality.exact);
  EXPECT_EQ(parse_used_scene(to_json(exact))->use, exact.use);
  document.erase("exact");
  for (const auto& [name, quality] : {std::pair("splats", Quality{.max_splats = 5000}),
                                      {"resolution", Quality{.resolution = 0}},
                                      {"max_error", Quality{.max_error = 0.01}}}) {
    json told = document;
    told.update(
        {{name, quality.max_error.value_or(quality.max_splats.value_or(0))}, {"sort", "axis"}, {"sampling", 3}});
    const UsedScene read = value_of(parse_used_scene(told.dump()));
    EXPECT_EQ(read.use.quality, quality);
    EXPECT_EQ(read.use.drawing, (Drawing{KernelKind::octant, SortMode::axis, 3}));
    EXPECT_EQ(parse_used_scene(to_json(read))->use, read.use);
  }
  document["tolerance"] = 0.5;
  EXPECT_EQ(used.scene, *parse_scene(valid_scene().dump()));
  for (const int indent : {1, -1}) {
    const auto again = parse_used_scene(to_json(used, indent));
    EXPECT_EQ(again->use, used.use);
    EXPECT_EQ(again->scene, used.scene);
  }
  EXPECT_EQ(to_json(used, -1).find('\n'), std::string::npos);
  EXPECT_EQ(load_used_scene(document.dump())->use.file, (std::filesystem::current_path() / "a.svol").string());
  document["file"] = "https://host/a.svol";
  EXPECT_EQ(load_used_scene(document.dump())->use.file, "https://host/a.svol");
}

TEST(ParseScene, TheScalarBarIsReadAndWrittenBack) {
  const auto scene = value_of(parse_scene(changed("/scalar_bar", {{"ticks", 9}, {"unit", "kPa"}})));
  EXPECT_EQ(scene.scalar_bar, (ScalarBar{9, "kPa"}));
  EXPECT_EQ(parse_scene(scene_to_json(scene))->scalar_bar, scene.scalar_bar);
  EXPECT_EQ(parse_scene(valid_scene().dump())->scalar_bar, ScalarBar());
  EXPECT_THAT(error_of(changed("/scalar_bar", {{"ticks", 1}})), StartsWith("scalar_bar.ticks: not a whole number"));
  EXPECT_THAT(error_of(changed("/scalar_bar", 3)), StartsWith("scalar_bar: not an object"));
  EXPECT_THAT(error_of(changed("/scalar_bar", {{"tick", 3}})), StartsWith("scalar_bar.tick: no such field"));
}

TEST(ParseScene, RefusesWrongUse) {
  EXPECT_THAT(error_of(changed("/file", "")), StartsWith("file: empty"));
  EXPECT_THAT(error_of(changed("/step", -1)), StartsWith("step: not a whole number"));
  EXPECT_THAT(error_of(changed("/step", 1.5)), StartsWith("step: not a whole number"));
  EXPECT_THAT(error_of(changed("/step", 1e99)), StartsWith("step: not a whole number"));
  EXPECT_THAT(error_of(changed("/max_error", 0)), StartsWith("max_error: not above 0"));
  EXPECT_THAT(error_of(changed("/tolerance", 101)), StartsWith("tolerance: 101 is outside [0, 100]"));
  EXPECT_THAT(error_of(changed("/kernel", "round")), StartsWith("kernel: 'round' is neither moments nor octant"));
  EXPECT_THAT(error_of(changed("/sort", "back")), StartsWith("sort: 'back' is none of none, axis and exact"));
  EXPECT_THAT(error_of(changed("/sampling", 0)), StartsWith("sampling: not a whole number"));
  EXPECT_THAT(error_of(changed("/splats", 0)), StartsWith("splats: not a whole number from 1"));
  EXPECT_THAT(error_of(changed("/resolution", 1.5)), StartsWith("resolution: not a whole number from 0"));
  EXPECT_THAT(error_of(changed("/milliseconds", 5)), StartsWith("milliseconds: no such field"));
  json both = valid_scene();
  both.update({{"tolerance", 1}, {"max_error", 0.1}});
  EXPECT_THAT(error_of(both.dump()), StartsWith("give one of max_error, splats, tolerance"));
  both.erase("tolerance");
  both.update({{"exact", true}});
  EXPECT_THAT(error_of(both.dump()), HasSubstr("with milliseconds, not 2"));
}

TEST(ParseScene, RefusesWrongSurfaces) {
  const auto error = [](const json& surface) { return error_of(changed("/surfaces", json::array({surface}))); };
  EXPECT_THAT(error({{"color", {1, 1, 1}}}), StartsWith("surfaces[0].file: missing"));
  EXPECT_THAT(error({{"file", ""}}), StartsWith("surfaces[0].file: empty"));
  EXPECT_THAT(error({{"boundary", ""}}), StartsWith("surfaces[0].boundary: empty"));
  EXPECT_THAT(error({{"file", "a"}, {"boundary", "b"}}), StartsWith("surfaces[0]: give \"file\" or \"boundary\""));
  EXPECT_THAT(error({{"file", "a"}, {"colour", {1, 1, 1}}}), StartsWith("surfaces[0].colour: no such field"));
  EXPECT_THAT(error({{"file", "a"}, {"color", {1, -1, 1}}}), StartsWith("surfaces[0].color: negative"));
  EXPECT_THAT(error({{"file", "a"}, {"opacity", 1.5}}), StartsWith("surfaces[0].opacity: 1.5"));
  EXPECT_THAT(error({{"file", "a"}, {"shown", 1}}), StartsWith("surfaces[0].shown: neither"));
  EXPECT_THAT(error({{"boundary", "a"}, {"near_side", "open"}}),
              StartsWith("surfaces[0].near_side: 'open' is none of shown, translucent and hidden"));
  EXPECT_THAT(error({{"boundary", "a"}, {"near_side", true}}), StartsWith("surfaces[0].near_side: "));
  EXPECT_THAT(error({{"file", "a"}, {"near_side", "hidden"}}),
              StartsWith("surfaces[0].near_side: only a patch, \"boundary\""));
  EXPECT_EQ(error({{"file", "a"}, {"near_side", "shown"}}), "accepted");
  EXPECT_THAT(error_of(changed("/surfaces", "a.stl")), StartsWith("surfaces: not a list"));
}

TEST(ParseScene, LightingIsOffOnOrGiven) {
  const auto lighting = [](const json& value) { return parse_scene(changed("/lighting", value))->lighting; };
  EXPECT_EQ(lighting(false), std::nullopt);
  EXPECT_EQ(lighting(true), (Lighting{0.3, 0.7}));
  EXPECT_EQ(lighting({{"ambient", 0}, {"diffuse", 0}}), (Lighting{0, 0}));
}

TEST(ParseScene, OrthographicNeedsItsHeightOnly) {
  json text = valid_scene();
  text["camera"]["projection"] = "orthographic";
  EXPECT_EQ(error_of(text.dump()), "camera.parallel_height: missing");
  text["camera"]["parallel_height"] = 2.5;
  text["camera"].erase("vertical_fov_degrees");
  const auto scene = value_of(parse_scene(text.dump()));
  EXPECT_EQ(scene.camera.projection, Camera::Projection::orthographic);
  EXPECT_EQ(scene.camera.parallel_height, 2.5);
}

TEST(ParseScene, NamesTheMissingField) {
  for (const char* pointer :
       {"/camera", "/camera/position", "/camera/focal_point", "/camera/up", "/camera/vertical_fov_degrees", "/image",
        "/image/width", "/image/height", "/attribute", "/transfer_function", "/transfer_function/domain",
        "/transfer_function/colors", "/transfer_function/density"}) {
    std::string name = pointer + 1;
    std::ranges::replace(name, '/', '.');
    EXPECT_EQ(error_of(changed(pointer)), name + ": missing");
  }
}

TEST(ParseScene, NamesTheWrongField) {
  const auto refuses = [](const std::string& pointer, const json& value, const std::string& field) {
    EXPECT_THAT(error_of(changed(pointer, value)), StartsWith(field + ": ")) << pointer << " = " << value;
  };
  refuses("/camera", 1, "camera");
  refuses("/camera/position", json::array({1, 2}), "camera.position");
  refuses("/camera/position", {1, 2, 3, 4}, "camera.position");
  refuses("/camera/position/1", "2", "camera.position[1]");
  refuses("/camera/position/1", nullptr, "camera.position[1]");
  refuses("/camera/position", {0, 0, 0}, "camera.focal_point");
  refuses("/camera/up", {0, 0, 0}, "camera.up");
  refuses("/camera/up", {-2, -4, -6}, "camera.up");
  refuses("/camera/projection", "fisheye", "camera.projection");
  refuses("/camera/projection", 3, "camera.projection");
  for (const double angle : {0.0, -30.0, 180.0, 1e9})
    refuses("/camera/vertical_fov_degrees", angle, "camera.vertical_fov_degrees");
  for (const json& side : {json(0), json(-1), json(1.5), json(16385), json("64"), json(1e300)}) {
    refuses("/image/width", side, "image.width");
    refuses("/image/height", side, "image.height");
  }
  refuses("/attribute", "", "attribute");
  refuses("/attribute", 1, "attribute");
  refuses("/background", {0, 0, -0.1}, "background");
  refuses("/background", "black", "background");
  refuses("/clip_box", json(1), "clip_box");
  refuses("/clip_box", {{"low", {0, 0, 0}}}, "clip_box.high");
  refuses("/clip_box", {{"low", {0, 0, 0}}, {"high", {1, 0, 1}}}, "clip_box");
  for (const json& lighting : {json(1), json("true"), json(nullptr), json::array({0.3, 0.7})})
    refuses("/lighting", lighting, "lighting");
  refuses("/lighting", json::object(), "lighting.ambient");
  refuses("/lighting", {{"ambient", 0.3}}, "lighting.diffuse");
  refuses("/lighting", {{"diffuse", 0.7}}, "lighting.ambient");
  refuses("/lighting", {{"ambient", -0.1}, {"diffuse", 1}}, "lighting.ambient");
  refuses("/lighting", {{"ambient", 0.1}, {"diffuse", -1e-9}}, "lighting.diffuse");
  refuses("/lighting", {{"ambient", true}, {"diffuse", 1}}, "lighting.ambient");
  refuses("/lighting", {{"ambient", 0.1}, {"diffuse", 1e38}}, "lighting.diffuse");
}

TEST(ParseScene, NamesTheWrongPartOfTheTransferFunction) {
  const auto refuses = [](const std::string& name, const json& value, const std::string& field) {
    EXPECT_THAT(error_of(changed("/transfer_function/" + name, value)),
                StartsWith("transfer_function." + field + ": "));
  };
  refuses("domain", {1, 1}, "domain");
  refuses("domain", {2, 1}, "domain");
  refuses("domain", {-1.1e100, 1}, "domain[0]");
  refuses("colors", {{0, 0, 1e38, 0}}, "colors[0][2]");
  refuses("density", {{0, 1e300}}, "density[0][1]");
  refuses("domain", json::array({1}), "domain");
  refuses("colors", json::array(), "colors");
  refuses("colors", 1, "colors");
  refuses("colors", {{0, 1, 1}}, "colors[0]");
  refuses("colors", {{0, 1, 1, -1}}, "colors[0]");
  refuses("density", json::array(), "density");
  refuses("density", {{0, 1}, {0.5, -1}}, "density[1]");
  refuses("density", {{0, 1}, {0.5, 1}, {0.4, 1}}, "density[2]");
  refuses("density", {{-0.1, 1}}, "density[0]");
  refuses("density", {{1.1, 1}}, "density[0]");
  refuses("density", {{0, 1}, {0.5, true}}, "density[1][1]");
  refuses("axis", "logarithmic", "axis");
  refuses("axis", 1, "axis");
  refuses("axis", "asinh", "linear_width");
  refuses("linear_width", 1, "linear_width");
}

TEST(ParseScene, TakesSoManyControlPointsAndNoMore) {
  json colors = json::array(), densities = json::array();
  for (int i = 0; i < 4096; ++i) {
    colors.push_back({i / 5000.0, 0, 0.5, 1});
    densities.push_back({i / 5000.0, 1});
  }
  EXPECT_EQ(error_of(changed("/transfer_function/colors", colors)), "accepted");
  EXPECT_EQ(error_of(changed("/transfer_function/density", densities)), "accepted");
  colors.push_back({1, 0, 0.5, 1});
  densities.push_back({1, 1});
  EXPECT_THAT(error_of(changed("/transfer_function/colors", colors)), HasSubstr("4097 control points; at most 4096"));
  EXPECT_THAT(error_of(changed("/transfer_function/density", densities)), HasSubstr("4097 control points"));
}

TEST(ParseScene, ReadsAndWritesTheAxis) {
  json document = valid_scene();
  json& function = document["transfer_function"];
  function["axis"] = "log";
  for (const json& domain : {json{-1, 1}, json{0, 1}}) {
    function["domain"] = domain;
    EXPECT_THAT(error_of(document.dump()), StartsWith("transfer_function.domain: "));
  }
  function["domain"] = {1e-6, 1e3};
  Scene scene = parse_scene(document.dump()).value();
  EXPECT_EQ(scene.transfer_function.axis, ValueAxis::log);
  EXPECT_EQ(parse_scene(scene_to_json(scene)).value().transfer_function, scene.transfer_function);

  function["domain"] = {-1e3, 1e3};
  function["axis"] = "asinh";
  for (const json& width : {json(0), json(-1), json("1")}) {
    function["linear_width"] = width;
    EXPECT_THAT(error_of(document.dump()), StartsWith("transfer_function.linear_width: "));
  }
  function["linear_width"] = 0.25;
  scene = parse_scene(document.dump()).value();
  EXPECT_EQ(scene.transfer_function.linear_width, 0.25);
  EXPECT_EQ(parse_scene(scene_to_json(scene)).value().transfer_function, scene.transfer_function);
  function["domain"] = {1e60, 1e60 * (1 + 1e-15)};
  EXPECT_THAT(error_of(document.dump()), StartsWith("transfer_function.domain: "));
}

TEST(ParseScene, TheFactorOfDensitiesIsReadAndWrittenBack) {
  const std::string field = "/transfer_function/density_factor";
  const Scene scene = parse_scene(changed(field, 0.25)).value();
  EXPECT_EQ(scene.transfer_function.density_factor, 0.25);
  EXPECT_EQ(parse_scene(scene_to_json(scene)).value(), scene);
  const Scene without = parse_scene(changed(field, 1)).value();
  EXPECT_EQ(scene_to_json(without).find("density_factor"), std::string::npos);
  EXPECT_THAT(error_of(changed(field, 0)), StartsWith("transfer_function.density_factor"));
}

TEST(ParseScene, RefusesWhatIsNoScene) {
  for (const char* text : {"", "{", "[]", "1", "null", "\"scene\"", "{\"camera\": }", "\xff\xfe", "{\"a\": 1e999}"}) {
    const std::string message = error_of(text);
    EXPECT_NE(message, "accepted") << text;
    EXPECT_EQ(message.find('\n'), std::string::npos) << message;
  }
}

TEST(ParseScene, EveryTruncationIsRefused) {
  const std::string text = valid_scene().dump();
  for (std::size_t length = 0; length < text.size(); ++length)
    EXPECT_NE(error_of(text.substr(0, length)), "accepted") << length;
}

TEST(Lighting, FactorForgetsTheSidesAndNeedsNoGradient) {
  const Lighting lighting{0.25, 0.5};
  const dvec3 ray(0, 0.6, 0.8);
  EXPECT_DOUBLE_EQ(lighting.factor(ray, ray), 0.75);
  EXPECT_DOUBLE_EQ(lighting.factor(ray, -ray), 0.75);
  EXPECT_DOUBLE_EQ(lighting.factor(ray, {0, 0, -1}), 0.25 + 0.5 * 0.8);
  EXPECT_DOUBLE_EQ(lighting.factor(ray, {1, 0, 0}), 0.25);
  EXPECT_DOUBLE_EQ(lighting.factor(ray, dvec3(0)), 0.75);
}

TEST(LoadScene, MessagesBeginWithThePath) {
  const TempFolder folder;
  const std::string missing = folder.path("no_such_scene.json");
  EXPECT_THAT(message_of(load_scene(missing)), StartsWith(missing + ": "));

  const std::string path = folder.write("scene.json", changed("/attribute"));
  const auto incomplete = load_scene(path);
  ASSERT_FALSE(incomplete);
  EXPECT_EQ(incomplete.error().message, path + ": attribute: missing");
}

TEST(LoadScene, FilesOfSurfacesBeginAtItsFolder) {
  const TempFolder folder;
  const auto scene = value_of(load_scene(folder.write(
      "a.json", changed("/surfaces", {{{"file", "parts/../a.stl"}}, {{"file", "/b.stl"}}, {{"boundary", "outer"}}}))));
  EXPECT_EQ(scene.surfaces[0].file, folder.path("a.stl"));
  EXPECT_EQ(scene.surfaces[1].file, "/b.stl");
  EXPECT_EQ(scene.surfaces[2], (SceneSurface{.boundary = "outer"}));
}

TEST(LoadScene, ReadsTheSharedScenes) {
  const std::filesystem::path folder = SPLATVOL_SHARED "/scenes";
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << "no scenes in " << folder;
  std::size_t count = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    EXPECT_EQ(message_of(load_scene(entry.path())), "");
    ++count;
  }
  EXPECT_GE(count, 7U);
}

}  // namespace
}  // namespace splatvol::test
