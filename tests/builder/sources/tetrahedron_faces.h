// The faces of tetrahedra, for tests that count them.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>

namespace splatvol::test {

/// The four faces of a tetrahedron: three corners each, in ascending order.
template <class Index>
std::array<std::array<Index, 3>, 4> faces_of(const std::array<Index, 4>& corners) {
  std::array<std::array<Index, 3>, 4> faces{};
  for (std::size_t left_out = 0; left_out < 4; ++left_out) {
    for (std::size_t i = 0, k = 0; i < 4; ++i)
      if (i != left_out) faces[left_out][k++] = corners[i];
    std::ranges::sort(faces[left_out]);
  }
  return faces;
}

}  // namespace splatvol::test
