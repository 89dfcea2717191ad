#include "viewer/window/gui_lists.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <utility>

namespace splatvol {
namespace {

struct Triangle {
  std::array<ImDrawVert, 3> vertices;
  ImVec4 clip;
};

bool are_same(const Triangle& a, const Triangle& b) { return std::memcmp(&a, &b, sizeof(Triangle)) == 0; }

bool are_same_commands(const ImDrawCmd& a, const ImDrawCmd& b) {
  return std::memcmp(&a.ClipRect, &b.ClipRect, sizeof(a.ClipRect)) == 0 && a.TextureId == b.TextureId &&
         a.VtxOffset == b.VtxOffset && a.IdxOffset == b.IdxOffset && a.ElemCount == b.ElemCount;
}

template <class Commands>
std::vector<Triangle> triangles_of(const ImDrawVert* vertices, const ImDrawIdx* indices, const Commands& commands) {
  std::vector<Triangle> triangles;
  for (const ImDrawCmd& command : commands) {
    const ImDrawVert* const of_command = vertices + command.VtxOffset;
    for (unsigned int i = command.IdxOffset; i < command.IdxOffset + command.ElemCount; i += 3)
      triangles.push_back(
          {{of_command[indices[i]], of_command[indices[i + 1]], of_command[indices[i + 2]]}, command.ClipRect});
  }
  return triangles;
}

std::vector<Triangle> triangles_of(const GuiLists::List& list) {
  return triangles_of(list.vertices.data(), list.indices.data(), list.commands);
}

std::vector<Triangle> triangles_of(const ImDrawList& list) {
  return triangles_of(list.VtxBuffer.Data, list.IdxBuffer.Data, list.CmdBuffer);
}

// Grows to the pixels that triangles touch. Counts in window units until the end.
class Bounds {
 public:
  void add(std::span<const Triangle> triangles) {
    for (const Triangle& triangle : triangles) add(triangle);
  }

  [[nodiscard]] PixelRect pixels(dvec2 scale) const {
    if (!(left_ < right_ && top_ < bottom_)) return {};
    static constexpr double most = 1e6;  // lines may end far outside of the window
    const auto below = [](double at) { return static_cast<int>(std::floor(std::clamp(at, -most, most))); };
    const auto above = [](double at) { return static_cast<int>(std::ceil(std::clamp(at, -most, most))); };
    return {below(left_ * scale.x), below(top_ * scale.y), above(right_ * scale.x), above(bottom_ * scale.y)};
  }

 private:
  void add(const Triangle& triangle) {
    const auto [a, b, c] = triangle.vertices;
    const float left = std::max(std::min({a.pos.x, b.pos.x, c.pos.x}), triangle.clip.x);
    const float top = std::max(std::min({a.pos.y, b.pos.y, c.pos.y}), triangle.clip.y);
    const float right = std::min(std::max({a.pos.x, b.pos.x, c.pos.x}), triangle.clip.z);
    const float bottom = std::min(std::max({a.pos.y, b.pos.y, c.pos.y}), triangle.clip.w);
    if (!(left < right && top < bottom)) return;
    left_ = std::min(left_, left), top_ = std::min(top_, top);
    right_ = std::max(right_, right), bottom_ = std::max(bottom_, bottom);
  }

  static constexpr float far_away = std::numeric_limits<float>::max();
  float left_ = far_away, top_ = far_away, right_ = -far_away, bottom_ = -far_away;
};

// Of all triangles, the first ones and the last ones are mostly the same: those between count.
PixelRect difference(std::span<const Triangle> before, std::span<const Triangle> after, dvec2 scale) {
  while (!before.empty() && !after.empty() && are_same(before.front(), after.front()))
    before = before.subspan(1), after = after.subspan(1);
  while (!before.empty() && !after.empty() && are_same(before.back(), after.back()))
    before = before.first(before.size() - 1), after = after.first(after.size() - 1);
  Bounds bounds;
  bounds.add(before);
  bounds.add(after);
  return bounds.pixels(scale);
}

}  // namespace

PixelRect clip_of(const ImDrawCmd& command, dvec2 scale) {
  return {static_cast<int>(command.ClipRect.x * scale.x), static_cast<int>(command.ClipRect.y * scale.y),
          static_cast<int>(command.ClipRect.z * scale.x), static_cast<int>(command.ClipRect.w * scale.y)};
}

bool GuiLists::List::is_same(const ImDrawList& list) const {
  const auto same_bytes = [](const auto& kept, const auto& items) {
    return std::cmp_equal(kept.size(), items.Size) &&
           (items.Size == 0 ||
            std::memcmp(kept.data(), items.Data, static_cast<std::size_t>(items.size_in_bytes())) == 0);
  };
  return same_bytes(vertices, list.VtxBuffer) && same_bytes(indices, list.IdxBuffer) &&
         std::equal(commands.begin(), commands.end(), list.CmdBuffer.begin(), list.CmdBuffer.end(), are_same_commands);
}

bool GuiLists::differ(std::span<const ImDrawList* const> lists) const {
  return !std::equal(lists_.begin(), lists_.end(), lists.begin(), lists.end(),
                     [](const List& kept, const ImDrawList* list) { return kept.is_same(*list); });
}

void GuiLists::keep(std::span<const ImDrawList* const> lists) {
  lists_.resize(lists.size());
  for (std::size_t l = 0; l < lists.size(); ++l) {
    const ImDrawList& list = *lists[l];
    lists_[l].vertices.assign(list.VtxBuffer.begin(), list.VtxBuffer.end());
    lists_[l].indices.assign(list.IdxBuffer.begin(), list.IdxBuffer.end());
    lists_[l].commands.assign(list.CmdBuffer.begin(), list.CmdBuffer.end());
  }
}

std::vector<PixelRect> GuiWindows::take(std::span<const ImDrawList* const> lists, dvec2 scale) {
  std::vector<PixelRect> changed;
  const std::vector<GuiLists::List>& before = kept_.lists();
  for (std::size_t l = lists.size(); l < before.size(); ++l) changed.push_back(bounds_[l]);
  bounds_.resize(lists.size());
  for (std::size_t l = 0; l < lists.size(); ++l) {
    if (l < before.size() && before[l].is_same(*lists[l])) continue;
    const std::vector<Triangle> was = l < before.size() ? triangles_of(before[l]) : std::vector<Triangle>();
    const std::vector<Triangle> is = triangles_of(*lists[l]);
    changed.push_back(difference(was, is, scale));
    Bounds bounds;
    bounds.add(is);
    bounds_[l] = bounds.pixels(scale);
  }
  kept_.keep(lists);
  return disjoint(std::move(changed));
}

}  // namespace splatvol
