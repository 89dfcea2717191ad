#include "format/polyhedron.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <utility>
#include <vector>

#include "tests/support/test_cells.h"

namespace splatvol::test {
namespace {

using namespace format;
using Triangles = std::vector<SurfaceTriangle>;

// The same triangles in one order, each from its lowest corner on.
Triangles in_order(Triangles triangles, bool mirrored) {
  for (SurfaceTriangle& t : triangles) {
    if (mirrored) std::swap(t[1], t[2]);
    std::ranges::rotate(t, std::ranges::min_element(t));
  }
  std::ranges::sort(triangles);
  return triangles;
}

TEST(Surfaces, ComeBack) {
  std::mt19937 random(5);
  for (std::size_t i = 0; i < 500; ++i) {
    const std::size_t corners = i == 0 ? max_polyhedron_corners : 4 + random() % (i % 10 == 0 ? 252 : 30);
    const Triangles surface = random_surface(corners, random);
    ASSERT_EQ(surface.size(), surface_triangles(corners));
    std::vector<std::byte> code;
    const SurfaceCoding coding = encode_surface(surface, corners, code);
    ASSERT_NE(coding, SurfaceCoding::failed);
    ASSERT_EQ(code.size(), surface_code_bytes(corners));
    Triangles back(surface.size());
    ASSERT_TRUE(decode_surface(code, corners, back));
    EXPECT_EQ(in_order(back, false), in_order(surface, coding == SurfaceCoding::mirrored));

    // Neither order nor the way round changes the code.
    Triangles other = in_order(surface, true);
    std::ranges::shuffle(other, random);
    std::vector<std::byte> same;
    ASSERT_NE(encode_surface(other, corners, same), SurfaceCoding::failed);
    EXPECT_EQ(same, code);
  }
}

TEST(Surfaces, AreRefusedIfTheyAreNoneOfASphere) {
  std::vector<std::byte> code;
  const auto fails = [&](const Triangles& triangles, std::size_t corners) {
    return encode_surface(triangles, corners, code) == SurfaceCoding::failed && code.empty();
  };
  const Triangles tetrahedron = {{0, 1, 2}, {0, 2, 3}, {0, 3, 1}, {1, 3, 2}};
  EXPECT_FALSE(fails(tetrahedron, 4));
  code.clear();
  EXPECT_TRUE(fails({{0, 1, 2}, {0, 2, 3}, {0, 3, 1}}, 4));             // a hole
  EXPECT_TRUE(fails({{0, 1, 2}, {0, 2, 3}, {0, 3, 1}, {1, 2, 3}}, 4));  // against its neighbours
  EXPECT_TRUE(fails({{0, 1, 2}, {0, 2, 1}, {0, 1, 3}, {0, 3, 1}}, 4));  // two parts that share edges
  EXPECT_TRUE(fails({{0, 0, 1}, {0, 1, 0}, {2, 2, 3}, {3, 3, 2}}, 4));  // no triangles
  EXPECT_TRUE(fails({{0, 1, 2}, {0, 2, 3}, {0, 3, 1}, {1, 3, 2}, {0, 2, 1}, {0, 1, 2}}, 5));  // edges of two triangles
  Triangles two = tetrahedron;
  for (const SurfaceTriangle& t : tetrahedron)
    two.push_back({static_cast<std::uint8_t>(t[0] + 4), static_cast<std::uint8_t>(t[1] + 4),
                   static_cast<std::uint8_t>(t[2] + 4)});
  EXPECT_TRUE(fails(two, 6));
  EXPECT_TRUE(fails(two, 8));
}

TEST(Surfaces, OfHostileBytesAreClosedOrRefused) {
  std::mt19937 random(6);
  std::size_t refused = 0, accepted = 0;
  for (std::size_t i = 0; i < 20000; ++i) {
    const std::size_t corners = 4 + random() % (i % 50 == 0 ? 252 : 6);
    std::vector<std::byte> code(surface_code_bytes(corners));
    for (std::byte& byte : code) byte = static_cast<std::byte>(i % 2 == 0 ? random() % 4 : random());
    Triangles back(surface_triangles(corners));
    if (!decode_surface(code, corners, back)) {
      ++refused;
      continue;
    }
    ++accepted;
    std::vector<int> triangles(corners * corners);  // [edge]
    for (const auto& [a, b, c] : back) {
      ASSERT_LT(std::max({a, b, c}), corners);
      ASSERT_TRUE(a != b && b != c && c != a);
      for (const auto& [from, to] : {std::pair(a, b), std::pair(b, c), std::pair(c, a)}) {
        EXPECT_EQ(++triangles[from * corners + to], 1);
      }
    }
    for (std::size_t from = 0; from < corners; ++from)
      for (std::size_t to = 0; to < from; ++to)
        EXPECT_EQ(triangles[from * corners + to], triangles[to * corners + from]);
    std::vector<std::byte> again;
    EXPECT_NE(encode_surface(back, corners, again), SurfaceCoding::failed);
  }
  EXPECT_GT(refused, 1000u);
  EXPECT_GT(accepted, 20u);
}

}  // namespace
}  // namespace splatvol::test
