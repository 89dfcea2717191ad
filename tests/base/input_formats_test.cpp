#include "base/input_formats.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <string_view>
#include <vector>

#include "base/file.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

// The table of docs/formats.md.
std::string table_of_page() {
  std::string text =
      "| format | extensions | files | held at once | time steps | cells | left out |\n|---|---|---|---|---|---|---|\n";
  const auto add = [&](std::string_view words) { text += words.empty() ? " |" : fmt::format(" {} |", words); };
  for (const FormatRow& row : input_formats()) {
    text += "|";
    add(row.name);
    add(row.extensions.empty() ? "any" : fmt::format("`{}`", row.extensions));
    for (const std::string_view words : {row.files, row.held, row.steps, row.cells, row.left_out}) add(words);
    text += "\n";
  }
  return text;
}

TEST(InputFormats, ThePageHasTheirTable) {
  const auto page = value_of(read_text_file(SPLATVOL_FORMATS_PAGE));
  EXPECT_NE(page.find(table_of_page()), std::string::npos) << "its table should be:\n" << table_of_page();
}

TEST(InputFormats, EachExtensionIsOfOneFormat) {
  std::vector<std::string_view> all;
  for (const FormatRow& row : input_formats()) {
    std::string_view rest = row.extensions;
    while (!rest.empty()) {
      const std::string_view extension = rest.substr(0, rest.find(' '));
      rest.remove_prefix(std::min(extension.size() + 1, rest.size()));
      EXPECT_EQ(format_of_name("a" + std::string(extension)), row.format) << extension;
      EXPECT_FALSE(is_foreign("a" + std::string(extension))) << extension;
      all.push_back(extension);
    }
  }
  std::ranges::sort(all);
  EXPECT_EQ(std::ranges::adjacent_find(all), all.end());
}

TEST(InputFormats, FilesToConvertAreKnownByName) {
  for (const char* name : {"a.vtu", "A.VTU", "b/a.e.4.0", "case/system/controlDict", "grid.xyz", "a.csv", "a.nc"})
    EXPECT_TRUE(is_convertible(name)) << name;
  for (const char* name : {"a.svol", "a.svols", "view.json", "wing.stl", "vtu", "https://host/a.svol"})
    EXPECT_FALSE(is_convertible(name)) << name;
}

TEST(InputFormats, FoldersToConvertHoldACaseOrFiles) {
  const TempFolder temp;
  temp.write("case/system/controlDict", "x");
  temp.write("pieces/notes.txt", "x");
  EXPECT_TRUE(is_convertible(temp.path("case")));
  EXPECT_TRUE(is_openfoam_case(temp.path("case")));
  EXPECT_FALSE(is_convertible(temp.path("pieces")));
  temp.write("pieces/.hidden.vtu", "x");
  EXPECT_FALSE(is_convertible(temp.path("pieces")));
  temp.write("pieces/a.vtu", "x");
  EXPECT_TRUE(is_convertible(temp.path("pieces")));
  EXPECT_FALSE(is_openfoam_case(temp.path("pieces")));
}

TEST(InputFormats, SurfacesAreNoVolumes) {
  for (const char* name : {"a.stl", "a.OBJ", "b/a.ply", "a.glb", "a.gltf"}) {
    EXPECT_TRUE(is_surface_file(name)) << name;
    EXPECT_FALSE(is_convertible(name)) << name;
  }
  EXPECT_FALSE(is_surface_file("a.vtu"));
}

}  // namespace
}  // namespace splatvol::test
