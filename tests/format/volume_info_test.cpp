#include "format/volume_info.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <nlohmann/json.hpp>

#include "tests/support/results.h"

namespace splatvol::test {
namespace {

using namespace format;
using nlohmann::json;
using testing::AllOf;
using testing::HasSubstr;

VolumeInfo example() {
  VolumeInfo info;
  info.cube = {{-1.5, 1e7, 0.1}, 3.25};
  info.resolution_counts = {10, 31, 100, (std::uint64_t{1} << 48) - 1};
  info.points_per_chunk = {64, 128, 65536, 1000};
  info.rows_per_directory_page = 3;
  info.reduction_method = "mis";
  info.leaf_points = 12;
  info.attributes = {{"Density", "kg/m^3", 101325.25, 0x1p100, 0.1, 1e60, 7, 0.25},
                     {"U[0] \"quoted\" \n \u00e9", "", 0, 1, std::nan(""), std::nan(""), 100}};
  info.columns = {
      {ColumnKind::position, ColumnScope::segment, -1},   {ColumnKind::value, ColumnScope::segment, 0},
      {ColumnKind::value, ColumnScope::segment, 1},       {ColumnKind::octant, ColumnScope::resolution, -1},
      {ColumnKind::moments, ColumnScope::resolution, -1}, {ColumnKind::value_moments, ColumnScope::resolution, 1},
      {ColumnKind::gradient, ColumnScope::segment, 1},    {ColumnKind::centroid, ColumnScope::resolution, -1}};
  info.size_bounds = {"octant", "moments"};
  info.provenance = R"({"builder":"test","census":{"VTK_TETRA":3}})";
  return info;
}

json example_json() { return json::parse(metadata_to_json(example()).value()); }

TEST(Metadata, ComesBack) {
  const VolumeInfo info = example();
  const auto back = value_of(metadata_from_json(metadata_to_json(info).value()));
  EXPECT_EQ(back.cube.origin, info.cube.origin);
  EXPECT_EQ(back.cube.edge, info.cube.edge);
  EXPECT_EQ(back.resolution_counts, info.resolution_counts);
  EXPECT_EQ(back.points_per_chunk, info.points_per_chunk);
  EXPECT_EQ(back.rows_per_directory_page, info.rows_per_directory_page);
  EXPECT_EQ(back.reduction_method, info.reduction_method);
  EXPECT_EQ(back.leaf_points, info.leaf_points);
  EXPECT_EQ(back.size_bounds, info.size_bounds);
  EXPECT_EQ(back.provenance, info.provenance);
  ASSERT_EQ(back.attributes.size(), 2u);
  for (std::size_t a = 0; a < 2; ++a) {
    EXPECT_EQ(back.attributes[a].name, info.attributes[a].name);
    EXPECT_EQ(back.attributes[a].unit, info.attributes[a].unit);
    EXPECT_EQ(back.attributes[a].offset, info.attributes[a].offset);
    EXPECT_EQ(back.attributes[a].scale, info.attributes[a].scale);
    EXPECT_EQ(back.attributes[a].missing, info.attributes[a].missing);
  }
  EXPECT_EQ(back.attributes[0].min, 0.1);
  EXPECT_EQ(back.attributes[0].max, 1e60);
  EXPECT_EQ(back.attributes[0].error, 0.25);
  EXPECT_TRUE(std::isnan(back.attributes[1].min) && std::isnan(back.attributes[1].max));
  ASSERT_EQ(back.columns.size(), info.columns.size());
  for (std::size_t c = 0; c < info.columns.size(); ++c) {
    EXPECT_EQ(back.columns[c].kind, info.columns[c].kind);
    EXPECT_EQ(back.columns[c].scope, info.columns[c].scope);
    EXPECT_EQ(back.columns[c].attribute, info.columns[c].attribute);
  }
  EXPECT_EQ(metadata_to_json(back).value(), metadata_to_json(info).value());
}

TEST(Metadata, FindsColumnsAndAttributes) {
  const VolumeInfo info = example();
  EXPECT_EQ(info.find_column(ColumnKind::position), 0);
  EXPECT_EQ(info.find_column(ColumnKind::value, 1), 2);
  EXPECT_EQ(info.find_column(ColumnKind::value), -1);
  EXPECT_EQ(info.find_column(ColumnKind::value_moments, 0), -1);
  EXPECT_EQ(info.find_attribute("Density"), 0);
  EXPECT_EQ(info.find_attribute("density"), -1);
  EXPECT_EQ(find_attribute(info, "Density", "a.svol").value(), 0);
  const auto none = find_attribute(info, "density", "a.svol");
  ASSERT_FALSE(none);
  EXPECT_EQ(none.error().code, ErrorCode::invalid_argument);
  EXPECT_TRUE(none.error().message.starts_with("a.svol: no attribute \"density\"; there are: Density, "));
}

TEST(Metadata, AnAliasIsAnotherNameOfAnAttribute) {
  VolumeInfo info = example();
  info.aliases = {{"rho", 0}, {"velocity", 1}, {"rho (cells)", 0}};
  const auto back = value_of(metadata_from_json(metadata_to_json(info).value()));
  EXPECT_EQ(back.aliases, info.aliases);
  EXPECT_EQ(back.find_attribute("rho (cells)"), 0);
  EXPECT_EQ(back.find_attribute("velocity"), 1);
  EXPECT_EQ(find_attribute(back, "velocity", "a.svol").value(), 1);
  EXPECT_THAT(find_attribute(back, "p", "a.svol").error().message, HasSubstr("rho (cells)"));
}

TEST(Metadata, AFileWithoutAttributesHasNoAliases) {
  json document = example_json();
  document["attributes"] = json::array();
  document["columns"] = json::array({document["columns"][0]});
  EXPECT_TRUE(metadata_from_json(document.dump()));
  document["aliases"] = {{{"name", "a"}, {"attribute", 0}}};
  EXPECT_THAT(metadata_from_json(document.dump()).error().message, HasSubstr("aliases"));
}

// Returns the paths of all values of the document.
void collect_paths(const json& node, const json::json_pointer& path, std::vector<json::json_pointer>& paths) {
  if (!path.empty()) paths.push_back(path);
  if (node.is_object())
    for (const auto& [key, child] : node.items()) collect_paths(child, path / key, paths);
  if (node.is_array())
    for (std::size_t i = 0; i < node.size(); ++i) collect_paths(node[i], path / i, paths);
}

bool is_for_people(const json::json_pointer& path) { return path.to_string().starts_with("/provenance/"); }

TEST(Metadata, NeedsEveryKey) {
  std::vector<json::json_pointer> paths;
  collect_paths(example_json(), json::json_pointer(), paths);
  ASSERT_GT(paths.size(), 60u);
  for (const auto& path : paths) {
    json document = example_json();
    if (is_for_people(path) || !document[path.parent_pointer()].is_object()) continue;
    document[path.parent_pointer()].erase(path.back());
    EXPECT_THAT(metadata_from_json(document.dump()), FailsWith(ErrorCode::invalid_data, HasSubstr("[R9]")))
        << path.to_string();
  }
}

TEST(Metadata, RefusesEveryOtherType) {
  std::vector<json::json_pointer> paths;
  collect_paths(example_json(), json::json_pointer(), paths);
  const std::vector<json> others = {nullptr, true, "text", json::array(), json::object(), -1, 1.5, 1e300};
  for (const auto& path : paths) {
    if (is_for_people(path)) continue;
    for (const json& other : others) {
      const json original = example_json()[path];
      const bool same_type = original.type() == other.type() || (original.is_number_float() && other.is_number());
      const bool null_allowed = other.is_null() && (path.back() == "min" || path.back() == "max") && original.is_null();
      if (same_type || null_allowed) continue;
      // A number instead of a null min or max shows, because the other one is still null.
      json document = example_json();
      document[path] = other;
      const auto info = metadata_from_json(document.dump());
      EXPECT_FALSE(info) << path.to_string() << " = " << other.dump();
    }
  }
}

TEST(Metadata, UnknownKeysAreIgnored) {
  json document = example_json();
  document["later"] = {{"a", 1}};
  document["cube"]["later"] = "x";
  document["attributes"][0]["later"] = json::array();
  EXPECT_TRUE(metadata_from_json(document.dump()));
}

struct Broken {
  const char* path;
  json value;
  const char* message;
};

json two_positions() {
  json columns = example_json()["columns"];
  columns.push_back(columns[0]);
  return columns;
}

const std::vector<Broken> values_out_of_range = {
    {"/cube/edge", 0, "edge"},
    {"/cube/edge", -1.5, "edge"},
    {"/cube/origin", {0, 0}, "origin"},
    {"/cube/origin", {0, 0, 0, 0}, "origin"},
    {"/cube/origin", {0, 0, nullptr}, "metadata: cube.origin[2]: not a number [R9]"},
    {"/resolution_counts", json::array(), "resolution_counts"},
    {"/resolution_counts", {0, 5}, "resolution_counts"},
    {"/resolution_counts", {5, 5}, "resolution_counts"},
    {"/resolution_counts", {5, 4}, "resolution_counts"},
    {"/resolution_counts", {5, -4}, "resolution_counts"},
    {"/resolution_counts", {5, 6.0}, "resolution_counts"},
    {"/resolution_counts", {5, "6"}, "resolution_counts"},
    {"/resolution_counts", {5, std::uint64_t{1} << 48}, "resolution_counts"},
    {"/resolution_counts", {5, ~std::uint64_t{0}}, "resolution_counts"},
    {"/points_per_chunk", 64, "points_per_chunk"},
    {"/points_per_chunk", json::array(), "points_per_chunk: 0 entries for 4 segments"},
    {"/points_per_chunk", {64, 64, 64}, "points_per_chunk: 3 entries for 4 segments"},
    {"/points_per_chunk", {64, 64, 64, 64, 64}, "points_per_chunk: 5 entries for 4 segments"},
    {"/points_per_chunk/0", 63, "points_per_chunk"},
    {"/points_per_chunk/3", 63, "points_per_chunk"},
    {"/points_per_chunk/1", 0, "points_per_chunk"},
    {"/points_per_chunk/1", -64, "points_per_chunk"},
    {"/points_per_chunk/1", 65537, "points_per_chunk"},
    {"/points_per_chunk/2", (std::uint64_t{1} << 32) + 64, "points_per_chunk"},
    {"/points_per_chunk/2", 64.5, "points_per_chunk"},
    {"/points_per_chunk/2", nullptr, "points_per_chunk"},
    {"/points_per_chunk/2", "64", "points_per_chunk"},
    {"/points_per_chunk/2", {64}, "metadata: points_per_chunk[2]: not a whole number from 64 to 65536 [R9]"},
    {"/rows_per_directory_page", 0, "rows_per_directory_page"},
    {"/rows_per_directory_page", (1 << 24) + 1, "rows_per_directory_page"},
    {"/reduction/leaf_points", 0, "metadata: reduction.leaf_points: not a whole number from 1 to 4294967295 [R9]"},
    {"/reduction/leaf_points", std::uint64_t{1} << 32, "leaf_points"},
    {"/attributes/0/missing", std::uint64_t{1} << 48, "missing"},
    {"/attributes/0/missing", -1, "missing"},
    {"/attributes/0/min", 1e301, "metadata: attributes[0]: min and max disagree [R9]"},
    {"/attributes/0/min", nullptr, "disagree"},
    {"/attributes/0/error", -1, "metadata: attributes[0].error: below 0 [R9]"},
    {"/position_error", -1, "position_error"},
    {"/aliases", json::object(), "aliases"},
    {"/aliases", {{{"name", "a"}}}, "attribute"},
    {"/aliases", {{{"attribute", 0}}}, "name"},
    {"/aliases", {{{"name", "a"}, {"attribute", 2}}}, "attribute"},
    {"/aliases", {{{"name", "a"}, {"attribute", -1}}}, "attribute"},
    {"/aliases", {{{"name", "a"}, {"attribute", "Density"}}}, "attribute"},
    {"/aliases", {{{"name", "Density"}, {"attribute", 1}}}, "appears twice"},
    {"/aliases", {{{"name", "a"}, {"attribute", 0}}, {{"name", "a"}, {"attribute", 1}}}, "appears twice"},
    {"/attributes/1/max", 3, "disagree"},
    {"/attributes/1/name", "Density", "'Density' appears twice"},
    {"/attributes", json::object(), "attributes"},
    {"/columns", json::array(), "position"},
    {"/columns", two_positions(), "twice"},
    {"/columns/1/attribute", 2, "attribute"},
    {"/columns/1/attribute", -1, "attribute"},
    {"/columns/1/attribute", 1e18, "attribute"},
    {"/columns/1/attribute", 1, "twice"},
    {"/columns/1/scope", "resolution", "scope"},
    {"/columns/3/scope", "segment", "scope"},
    {"/columns/3/scope", "node", "scope"},
    {"/columns/0/attribute", 0, "attribute"},
    {"/size_bounds", std::vector<std::string>(17, "x"), "size_bounds: more than 16 names"},
    {"/size_bounds", {1}, "size_bounds"},
    {"/provenance", "text", "provenance"},
};

TEST(Metadata, RefusesWhatIsOutOfRange) {
  for (const Broken& broken : values_out_of_range) {
    json document = example_json();
    document[json::json_pointer(broken.path)] = broken.value;
    EXPECT_THAT(message_of(metadata_from_json(document.dump())), AllOf(HasSubstr("[R9]"), HasSubstr(broken.message)))
        << broken.path << " = " << broken.value.dump();
  }
}

TEST(Metadata, RefusesScalesThatAreNotAboveZero) {
  json document = example_json();
  for (const json& scale : {json(0), json(-1), json("1"), json(nullptr)}) {
    document["attributes"][0]["scale"] = scale;
    EXPECT_THAT(message_of(metadata_from_json(document.dump())), AllOf(HasSubstr("[R9]"), HasSubstr("scale")))
        << scale.dump();
  }
  document["attributes"][0]["scale"] = 0x1p-1022;  // the range in stored values overflows
  document["attributes"][0]["max"] = 1e10;
  EXPECT_FALSE(metadata_from_json(document.dump()));
}

TEST(Metadata, RefusesRangesWhoseLengthIsInfinite) {
  json document = example_json();
  for (const double bad : {1e61, -1e61, 1e308}) {
    document["cube"]["origin"][1] = bad;
    EXPECT_FALSE(metadata_from_json(document.dump()));
  }
  document = example_json();
  for (const double edge : {1e-61, 1e-320, 1e61, 1e308}) {
    document["cube"]["edge"] = edge;
    EXPECT_THAT(metadata_from_json(document.dump()).error().message, HasSubstr("edge"));
  }
  document = example_json();
  document["attributes"][0]["scale"] = 1e-20;  // stored values pass single precision
  EXPECT_FALSE(metadata_from_json(document.dump()));
  for (const char* key : {"offset", "scale", "min", "max"})
    for (const double bad : {1.1e102, -1.1e102, 1.7e308}) {
      document = example_json();
      document["attributes"][0][key] = bad;
      EXPECT_FALSE(metadata_from_json(document.dump())) << key << bad;
    }
  document = example_json();
  document["attributes"][0]["min"] = -1e60;
  EXPECT_TRUE(metadata_from_json(document.dump()));
}

TEST(Metadata, RefusesTooManyResolutions) {
  json document = example_json();
  std::vector<std::uint64_t> counts(64);
  for (std::size_t i = 0; i < 64; ++i) counts[i] = 1000 + i;
  document["resolution_counts"] = counts;
  document["points_per_chunk"] = std::vector<int>(64, 64);
  EXPECT_TRUE(metadata_from_json(document.dump()));
  counts.push_back(5000);
  document["resolution_counts"] = counts;
  document["points_per_chunk"] = std::vector<int>(65, 64);
  EXPECT_FALSE(metadata_from_json(document.dump()));
}

TEST(Metadata, SkipsUnknownColumnsUnlessTheyAreCritical) {
  json document = example_json();
  document["columns"].push_back({{"kind", "later"}, {"scope", "resolution"}, {"critical", false}});
  const auto info = value_of(metadata_from_json(document.dump()));
  EXPECT_EQ(info.columns.back().kind, ColumnKind::unknown);
  EXPECT_EQ(info.columns.back().scope, ColumnScope::resolution);
  document["columns"].back()["critical"] = true;
  EXPECT_THAT(metadata_from_json(document.dump()).error().message, HasSubstr("'later'"));
}

TEST(Metadata, EachKindHasItsScopeAndItsAttribute) {
  for (std::size_t c = 0; c < example().columns.size(); ++c) {
    json document = example_json();
    json& column = document["columns"][c];
    ASSERT_TRUE(metadata_from_json(document.dump()));
    column["scope"] = column["scope"] == "segment" ? "resolution" : "segment";
    EXPECT_THAT(metadata_from_json(document.dump()).error().message, HasSubstr("scope")) << column.dump();

    document = example_json();
    if (document["columns"][c].contains("attribute"))
      document["columns"][c].erase("attribute");
    else
      document["columns"][c]["attribute"] = 0;
    EXPECT_THAT(metadata_from_json(document.dump()).error().message, HasSubstr("attribute")) << c;

    document = example_json();
    document["columns"].push_back(document["columns"][c]);
    EXPECT_THAT(metadata_from_json(document.dump()).error().message, HasSubstr("twice")) << c;
  }
}

TEST(Metadata, UnknownSizeBoundsAreKept) {
  json document = example_json();
  document["size_bounds"].push_back("later");
  EXPECT_EQ(metadata_from_json(document.dump()).value().size_bounds.back(), "later");
}

TEST(Metadata, IsJsonOrRefused) {
  for (const std::string text : {"", "{", "[]", "null", "5", "{}", "{\"cube\": 1e400}", "\xFF\xFE", "{\"a\":\"\xC3\"}"})
    EXPECT_FALSE(metadata_from_json(text)) << text;
  const std::string whole = metadata_to_json(example()).value();
  for (std::size_t length = 0; length < whole.size(); ++length)
    EXPECT_FALSE(metadata_from_json(whole.substr(0, length)));
}

TEST(Metadata, DeepNestingIsRefusedBeforeItExhaustsTheStack) {
  const std::string text = example_json().dump();
  const auto nested = [&](std::size_t levels, const std::string& open, const std::string& close) {
    std::string value = "0";
    std::string prefix, suffix;
    for (std::size_t i = 0; i < levels; ++i) prefix += open, suffix += close;
    return metadata_from_json("{\"later\":" + prefix + value + suffix + "," + text.substr(1));
  };
  EXPECT_TRUE(nested(31, "[", "]"));
  EXPECT_TRUE(nested(31, "{\"a\":", "}"));
  for (const std::size_t levels : {32, 1000, 2'000'000}) {
    EXPECT_THAT(nested(levels, "[", "]").error().message, HasSubstr("nested"));
    EXPECT_THAT(nested(levels, "{\"a\":", "}").error().message, HasSubstr("nested"));
  }
  json document = example_json();
  document["attributes"][0]["name"] = std::string(1000, '[') + "\\\"" + std::string(1000, '{');
  EXPECT_TRUE(metadata_from_json(document.dump()));
}

TEST(Metadata, LongListsTakeLinearTime) {
  std::string list = "[{}";
  for (int i = 0; i < 1'000'000; ++i) list += ",{}";
  EXPECT_TRUE(metadata_from_json("{\"later\":" + list + "]," + example_json().dump().substr(1)));
}

TEST(Metadata, WritesNothingThatCannotBeRead) {
  const auto refused = [](const std::function<void(VolumeInfo&)>& change) {
    VolumeInfo info = example();
    change(info);
    const auto text = metadata_to_json(info);
    if (!text) {
      EXPECT_EQ(text.error().code, ErrorCode::invalid_argument);
    }
    return !text;
  };
  EXPECT_FALSE(refused([](VolumeInfo&) {}));
  EXPECT_TRUE(refused([](VolumeInfo& info) { info.provenance = "no JSON"; }));
  EXPECT_TRUE(refused([](VolumeInfo& info) { info.provenance = "[]"; }));
  EXPECT_TRUE(refused([](VolumeInfo& info) { info.cube.edge = std::nan(""); }));
  EXPECT_TRUE(refused([](VolumeInfo& info) { info.resolution_counts.clear(); }));
  EXPECT_TRUE(refused([](VolumeInfo& info) { info.columns[0].kind = ColumnKind::unknown; }));
  EXPECT_TRUE(refused([](VolumeInfo& info) { info.columns.clear(); }));
  EXPECT_TRUE(refused([](VolumeInfo& info) { info.points_per_chunk[1] = 0; }));
  EXPECT_TRUE(refused([](VolumeInfo& info) { info.points_per_chunk.pop_back(); }));
  EXPECT_TRUE(refused([](VolumeInfo& info) { info.attributes[0].max = std::numeric_limits<double>::infinity(); }));
  EXPECT_TRUE(refused([](VolumeInfo& info) { info.attributes[1].name = info.attributes[0].name; }));
}

TEST(Metadata, NamesThatAreNotUtf8AreMadeSo) {
  VolumeInfo info = example();
  info.attributes[0].name = "caf\xE9";
  const auto back = value_of(metadata_from_json(metadata_to_json(info).value()));
  EXPECT_EQ(back.attributes[0].name, "caf\uFFFD");
  info.attributes[1].name = "caf\xE8";  // the same name after replacing
  EXPECT_FALSE(metadata_to_json(info));
}

}  // namespace
}  // namespace splatvol::test
