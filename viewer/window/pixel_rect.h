// Parts of the window.
#pragma once

#include <vector>

namespace splatvol {

/// A part of the framebuffer, in pixels from the upper left corner.
struct PixelRect {
  int left = 0, top = 0, right = 0, bottom = 0;

  [[nodiscard]] bool is_empty() const { return right <= left || bottom <= top; }
  friend bool operator==(const PixelRect&, const PixelRect&) = default;
};

/// Returns what is in both; an empty rectangle if that is nothing.
[[nodiscard]] PixelRect intersection(const PixelRect& a, const PixelRect& b);

/// Joins rectangles that overlap: the result covers those given, and no two overlap. Leaves out empty ones.
[[nodiscard]] std::vector<PixelRect> disjoint(std::vector<PixelRect> rects);

}  // namespace splatvol
