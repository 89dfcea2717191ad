#include "viewer/window/pixel_rect.h"

#include <algorithm>

namespace splatvol {
namespace {

bool overlap(const PixelRect& a, const PixelRect& b) { return !intersection(a, b).is_empty(); }

PixelRect around(const PixelRect& a, const PixelRect& b) {
  return {std::min(a.left, b.left), std::min(a.top, b.top), std::max(a.right, b.right), std::max(a.bottom, b.bottom)};
}

}  // namespace

PixelRect intersection(const PixelRect& a, const PixelRect& b) {
  const PixelRect both{std::max(a.left, b.left), std::max(a.top, b.top), std::min(a.right, b.right),
                       std::min(a.bottom, b.bottom)};
  return both.is_empty() ? PixelRect{} : both;
}

std::vector<PixelRect> disjoint(std::vector<PixelRect> rects) {
  std::vector<PixelRect> joined;
  for (PixelRect rect : rects) {
    if (rect.is_empty()) continue;
    // What has grown may overlap others.
    for (auto other = joined.begin(); other != joined.end();) {
      if (!overlap(rect, *other)) {
        ++other;
        continue;
      }
      rect = around(rect, *other);
      joined.erase(other);
      other = joined.begin();
    }
    joined.push_back(rect);
  }
  return joined;
}

}  // namespace splatvol
