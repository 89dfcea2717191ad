// Files of surfaces, as programs read them: in the reader's process.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "base/file.h"
#include "builder/sources/process/reader_process.h"
#include "tests/builder/sources/read_input.h"
#include "tests/renderer/surfaces/shapes.h"
#include "tests/support/replaced.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

using namespace ::testing;

/// A square of side 2 at z = 3, as each format writes it.
struct SurfaceText {
  const char* name;
  std::string text;
};

std::vector<SurfaceText> squares() {
  return {
      {"a.stl",
       "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 3\nvertex 2 0 3\nvertex 2 2 3\nendloop\nendfacet\n"
       "facet normal 0 0 1\nouter loop\nvertex 0 0 3\nvertex 2 2 3\nvertex 0 2 3\nendloop\nendfacet\nendsolid a\n"},
      {"b.stl", stl_of(plate({0, 0, 3}, {2, 0, 0}, {0, 2, 0}))},
      {"a.obj", "v 0 0 3\nv 2 0 3\nv 2 2 3\nv 0 2 3\nf 1 2 3 4\n"},
      {"a.ply",
       "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n"
       "property list uchar int vertex_indices\nend_header\n0 0 3\n2 0 3\n2 2 3\n0 2 3\n4 0 1 2 3\n"},
      {"a.vtk",
       "# vtk DataFile Version 3.0\na\nASCII\nDATASET POLYDATA\nPOINTS 4 float\n0 0 3 2 0 3 2 2 3 0 2 3\n"
       "POLYGONS 1 5\n4 0 1 2 3\n"},
      {"a.vtp",
       "<VTKFile type=\"PolyData\" version=\"0.1\"><PolyData><Piece NumberOfPoints=\"4\" NumberOfVerts=\"0\" "
       "NumberOfLines=\"0\" NumberOfStrips=\"1\" NumberOfPolys=\"0\"><Points><DataArray type=\"Float64\" "
       "NumberOfComponents=\"3\" format=\"ascii\">0 0 3 2 0 3 0 2 3 2 2 3</DataArray></Points><Strips><DataArray "
       "type=\"Int32\" Name=\"connectivity\" format=\"ascii\">0 1 2 3</DataArray><DataArray type=\"Int32\" "
       "Name=\"offsets\" format=\"ascii\">4</DataArray></Strips></Piece></PolyData></VTKFile>"},
      // Positions (0 0 0) (2 0 0) (2 2 0) (0 2 0) and indices 0 1 2 0 2 3; the node moves them by 3.
      {"a.gltf",
       R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0,"translation":[0,0,3]}],)"
       R"("meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1,"mode":4}]}],"accessors":[{"bufferView":0,)"
       R"("componentType":5126,"count":4,"type":"VEC3","min":[0,0,0],"max":[2,2,0]},{"bufferView":1,)"
       R"("componentType":5123,"count":6,"type":"SCALAR"}],"bufferViews":[{"buffer":0,"byteOffset":0,"byteLength":48},)"
       R"({"buffer":0,"byteOffset":48,"byteLength":12}],"buffers":[{"byteLength":60,"uri":"data:application/)"
       R"(octet-stream;base64,AAAAAAAAAAAAAAAAAAAAQAAAAAAAAAAAAAAAQAAAAEAAAAAAAAAAAAAAAEAAAAAAAAABAAIAAAACAAMA"}]})"}};
}

/// The text of one of them.
std::string square_text(std::string_view name) {
  const auto all = squares();
  return std::ranges::find(all, name, &SurfaceText::name)->text;
}

struct SurfaceFiles : FolderTest {
  Result<TriangleMesh> read(const std::string& path) { return reader_.read_surface(path); }

  std::string error_of(const std::string& path) {
    const auto mesh = read(path);
    if (mesh) return "(no error)";
    EXPECT_EQ(mesh.error().message.find('\n'), std::string::npos) << mesh.error().message;
    return mesh.error().message;
  }

  ReaderProcess reader_{reader_options()};
};

TEST_F(SurfaceFiles, OfEachFormatGiveTheSameTriangles) {
  for (const auto& [name, text] : squares()) {
    const auto mesh = value_of(read(write(name, text)));
    ASSERT_EQ(mesh.triangles.size(), 2u) << name;
    double area = 0;
    Box box;
    for (const auto& [a, b, c] : mesh.triangles) {
      const auto& p = mesh.points;
      area += glm::length(glm::cross(p[b] - p[a], p[c] - p[a])) / 2;
      for (const std::uint32_t corner : {a, b, c}) box.include(Box{p[corner], p[corner]});
    }
    EXPECT_NEAR(area, 4, 1e-6) << name;
    EXPECT_EQ(box.low, dvec3(0, 0, 3)) << name;
    EXPECT_EQ(box.high, dvec3(2, 2, 3)) << name;
  }
}

TEST_F(SurfaceFiles, TrianglesAtNumbersThatAreNoneAreLeftOut) {
  TriangleMesh odd = plate({0, 0, 0}, {2, 0, 0}, {0, 2, 0}, 2);  // 8 triangles
  odd.points[0].y = std::nan("");                                // a corner of 2
  odd.points[2].x = 1e60;                                        // of 1
  const auto mesh = value_of(read(write("a.stl", stl_of(odd))));
  EXPECT_EQ(mesh.triangles.size(), 5u);
}

TEST_F(SurfaceFiles, WithoutASurfaceAreRefused) {
  EXPECT_THAT(error_of(write("a.xyz", "0 0 0\n")), StartsWith(path("a.xyz") + ": no surface: take a .stl"));
  EXPECT_THAT(error_of(path("none.stl")), StartsWith(path("none.stl") + ": cannot open"));
  for (const char* name : {"e.stl", "e.obj", "e.ply", "e.gltf", "e.glb", "e.vtp", "e.vtk"}) {
    EXPECT_THAT(error_of(write(name, "")), StartsWith(path(name) + ": "));
    EXPECT_THAT(error_of(write(name, "no surface at all\n")), StartsWith(path(name) + ": "));
  }
  EXPECT_THAT(error_of(write("p.obj", "v 0 0 0\n")), HasSubstr("no triangles"));
}

// A cut or damaged file is refused, or gives some triangles. It never harms the program: the next file is read.
TEST_F(SurfaceFiles, ThatAreDamagedDoNoHarm) {
  for (const auto& [name, text] : squares()) {
    const std::size_t step = std::max<std::size_t>(1, text.size() / 40);
    for (std::size_t cut = 0; cut < text.size(); cut += step) {
      (void)error_of(write(name, text.substr(0, cut)));
      std::string flipped = text;
      flipped[cut] = static_cast<char>(flipped[cut] ^ 0x55);
      (void)error_of(write(name, flipped));
    }
    EXPECT_EQ(error_of(write(name, text)), "(no error)");
  }
}

// Lines of an .obj do not tell how many follow.
TEST_F(SurfaceFiles, ThatAreCutOffAreRefused) {
  for (const auto& [name, text] : squares()) {
    if (std::string_view(name) == "a.obj") continue;
    constexpr std::size_t last = 12;  // bytes that no triangle needs
    for (std::size_t cut = 0; cut < text.size() - last; cut += 1 + text.size() / 40)
      EXPECT_THAT(error_of(write(name, text.substr(0, cut))), StartsWith(path(name) + ": ")) << cut;
  }
}

/// The square of squares(), shown by these nodes. The scene shows node 0, and mesh 0 is the square.
std::string square_shown_by(const std::string& nodes) {
  return replaced(square_text("a.gltf"), R"("nodes":[{"mesh":0,"translation":[0,0,3]}],)",
                  R"("nodes":[)" + nodes + "],");
}

/// Nodes that each show the next one twice, and the last the square.
std::string doublings(int count) {
  std::string nodes;
  for (int i = 1; i <= count; ++i) nodes += fmt::format(R"({{"children":[{0},{0}]}},)", i);
  return nodes + R"({"mesh":0})";
}

TEST_F(SurfaceFiles, ThatShowTheirPartsTooOftenAreRefused) {
  const auto mesh = value_of(read(write("a.gltf", square_shown_by(doublings(3)))));
  EXPECT_EQ(mesh.triangles.size(), 16u);
  for (const int count : {21, 30, 60, 5000})
    EXPECT_THAT(error_of(write("a.gltf", square_shown_by(doublings(count)))),
                AllOf(StartsWith(path("a.gltf") + ": its scenes show "), HasSubstr("at most 1048576 parts are read")))
        << count;
  EXPECT_THAT(error_of(write("a.gltf", square_shown_by(doublings(30)))), HasSubstr("1.07e+09 parts"));
  // Nodes without a mesh take as long.
  const std::string empty = replaced(doublings(30), "\"mesh\":0", "");
  EXPECT_THAT(error_of(write("a.gltf", square_shown_by(empty))), HasSubstr("nodes with 0 parts"));
  const std::string json = square_shown_by(doublings(30));
  const auto size = static_cast<std::uint32_t>(json.size());
  const auto number = [](std::uint32_t n) { return std::string(reinterpret_cast<const char*>(&n), sizeof(n)); };
  EXPECT_THAT(error_of(write("a.glb", "glTF" + number(2) + number(size + 20) + number(size) + "JSON" + json)),
              HasSubstr("1.07e+09 parts"));
}

TEST_F(SurfaceFiles, WhoseNodesContradictThemselvesAreRefused) {
  for (const char* nodes : {R"({"children":[0]})", R"({"children":[1]},{"mesh":0,"children":[2]},{"children":[1]})"})
    EXPECT_THAT(error_of(write("a.gltf", square_shown_by(nodes))), HasSubstr("a node contains itself")) << nodes;
  for (const char* nodes : {R"({"children":[1]})", R"({"children":[-1]})", R"({"mesh":1})", R"({"children":[0.5]})"})
    EXPECT_THAT(error_of(write("a.gltf", square_shown_by(nodes))), HasSubstr("that is not there")) << nodes;
  EXPECT_THAT(error_of(write("a.gltf", square_shown_by(R"({"children":7})"))), HasSubstr("its children are no list"));
  EXPECT_THAT(error_of(write("a.gltf", std::string(100'000, '['))), HasSubstr("nested deeper"));
}

/// A .ply file of the square, in binary.
std::string binary_ply(bool big_endian) {
  std::string text = fmt::format(
      "ply\nformat binary_{}_endian 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
      "element face 1\nproperty list uchar int vertex_indices\nend_header\n",
      big_endian ? "big" : "little");
  const auto put = [&](std::uint32_t number) {
    for (int i = 0; i < 4; ++i) text += static_cast<char>(number >> (big_endian ? 24 - 8 * i : 8 * i));
  };
  for (const float number : {0.f, 0.f, 3.f, 2.f, 0.f, 3.f, 2.f, 2.f, 3.f, 0.f, 2.f, 3.f})
    put(std::bit_cast<std::uint32_t>(number));
  text += '\4';
  for (std::uint32_t i = 0; i < 4; ++i) put(i);
  return text;
}

TEST_F(SurfaceFiles, OfBinaryPlyAreWhole) {
  for (const bool big_endian : {false, true}) {
    const std::string whole = binary_ply(big_endian);
    const auto mesh = value_of(read(write("a.ply", whole)));
    EXPECT_EQ(mesh.triangles.size(), 2u);
    for (std::size_t bytes = 0; bytes < whole.size(); ++bytes)
      EXPECT_THAT(error_of(write("a.ply", whole.substr(0, bytes))), StartsWith(path("a.ply") + ": ")) << bytes;
  }
}

// Lines of an .obj do not tell how many follow: what is left must be whole by itself.
TEST_F(SurfaceFiles, OfObjThatAreCutOff) {
  const std::string obj =
      "v 0 0 3\nv 2 0 3\nv 2 2 3\nv 0 2 3\nvn 0 0 1\nvt 0 0\nf 1/1/1 2/1/1 3/1/1\n"
      "f 1/1/1 3/1/1 \\\n4/1/1\nf -4/1/1 -2/1/1 -1/1/1\n# the end\n";
  const auto mesh = value_of(read(write("a.obj", obj)));
  ASSERT_EQ(mesh.triangles.size(), 3u);
  for (const char* text : {"v 0 0", "v 0 0 x", "v 0 0 1,5", "v 0,5 0 1", "vn 0 0", "vn 0 0 1,5", "vt 0,5", "f 1 2",
                           "f 1", "f", "v", "f 1 2 5", "f 1 2 0", "f -1 -2 -5", "f 1 2 3.5", "f 1 2 3/x"}) {
    EXPECT_THAT(error_of(write("b.obj", obj + text + "\n")), StartsWith(path("b.obj") + ": ")) << text;
    EXPECT_NE(error_of(write("b.obj", obj + text)), "(no error)") << text;
  }
  EXPECT_EQ(error_of(write("b.obj", obj + "o a\ng b\nusemtl c\ns off\nl 1 2\nv 0 0 1 0.5 0.5 0.5\n")), "(no error)");
}

TEST_F(SurfaceFiles, ThatEndWithANumberAreTold) {
  const auto open_end = [&](const char* name, const std::string& text) {
    const auto mesh = read(write(name, text));
    EXPECT_TRUE(mesh) << mesh.error().message;
    if (!mesh) return false;
    EXPECT_THAT(mesh->triangles, SizeIs(AnyOf(1, 2))) << name;
    for (const auto& triangle : mesh->triangles)
      for (const std::uint32_t point : triangle) EXPECT_EQ(mesh->points[point].z, 3) << name;
    return mesh->open_end;
  };
  for (const auto& [name, text] : squares()) EXPECT_FALSE(open_end(name, text)) << name;
  for (const char* name : {"a.obj", "a.ply"}) {
    const std::string text = square_text(name);
    EXPECT_TRUE(open_end(name, text.substr(0, text.size() - 1))) << name;
    EXPECT_FALSE(open_end(name, text.substr(0, text.size() - 1) + "\r\n")) << name;
  }
  EXPECT_FALSE(open_end("a.obj", "v 0 0 3\nv 2 0 3\nv 2 2 3\nf 1 2 3\n# the end"));
  const std::string solid = square_text("a.stl");
  EXPECT_FALSE(open_end("a.stl", solid.substr(0, solid.size() - 1)));
}

// VTK's reader takes the first elements for vertices and faces, loses long lines and counts corners in a byte.
TEST_F(SurfaceFiles, OfPlyThatVtkMisreadsAreRefused) {
  const std::string text = square_text("a.ply");
  const std::string material = "element material 1\nproperty float r\nproperty float g\nproperty float b\n";
  const auto changed = [&](std::vector<std::pair<std::string, std::string>> insertions) {
    std::string all_of_it = text;
    for (const auto& [before, what] : insertions) all_of_it.insert(all_of_it.find(before), what);
    return write("a.ply", all_of_it);
  };
  EXPECT_THAT(error_of(changed({{"element vertex", material}, {"0 0 3", "9 9 9\n"}})),
              HasSubstr("vertices must come first"));
  EXPECT_THAT(error_of(changed({{"element face", material}, {"4 0 1 2 3", "9 9 9\n"}})),
              HasSubstr("vertices must come first"));
  EXPECT_EQ(error_of(write("a.ply", text.substr(0, text.find("end_header")) + material +
                                        text.substr(text.find("end_header")) + "9 9 9\n")),
            "(no error)");
  EXPECT_THAT(error_of(changed({{"2 0 3", std::string(5000, ' ')}})), HasSubstr("a line is longer"));
  EXPECT_THAT(error_of(changed({{"element face", "comment " + std::string(5000, 'a') + "\n"}})),
              HasSubstr("a line is longer"));
  std::string corners = "257";
  for (int i = 0; i < 257; ++i) corners += fmt::format(" {}", i % 4);
  const std::string wide = replaced(replaced(text, "list uchar", "list int"), "4 0 1 2 3", corners);
  EXPECT_THAT(error_of(write("a.ply", wide)), HasSubstr("more than 255 corners"));
}

TEST_F(SurfaceFiles, WithDecimalCommasAreRefused) {
  for (const auto& [name, text] : squares()) {
    std::string commas = text;
    const std::size_t at = commas.find("2 0 3");
    if (at == std::string::npos) continue;  // no text
    EXPECT_THAT(error_of(write(name, commas.replace(at, 1, "2,5"))), StartsWith(path(name) + ": ")) << name;
    EXPECT_THAT(error_of(write(name, commas.replace(at, 7, "2 0 3,5"))), StartsWith(path(name) + ": ")) << name;
  }
}

// Indices beyond the points, and counts beyond the file.
TEST_F(SurfaceFiles, ThatLieAreRefused) {
  for (const auto& [name, from, to] :
       {std::tuple{"a.obj", "f 1 2 3 4", "f 1 2 3 400000000"}, std::tuple{"a.ply", "4 0 1 2 3", "4 0 1 2 300000000"},
        std::tuple{"a.vtk", "4 0 1 2 3", "4 0 1 2 300000000"}, std::tuple{"a.vtp", "0 1 2 3", "0 1 2 300000000"},
        std::tuple{"a.ply", "vertex 4", "vertex 2000000000"}, std::tuple{"a.vtk", "POINTS 4", "POINTS 2000000000"},
        std::tuple{"a.gltf", "\"count\":4", "\"count\":2000000000"}}) {
    std::string text = square_text(name);
    ASSERT_NE(text.find(from), std::string::npos) << name;
    text.replace(text.rfind(from), std::string_view(from).size(), to);
    EXPECT_THAT(error_of(write(name, text)), StartsWith(path(name) + ": ")) << to;
  }
}

}  // namespace
}  // namespace splatvol::test
