#include "builder/points/boundary_corners.h"

#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>
#include <vector>

#include "format/codec.h"

namespace splatvol {

bool operator==(const Corner& a, const Corner& b) { return a.position == b.position && a.values_hash == b.values_hash; }

bool operator<(const Corner& a, const Corner& b) {
  return std::tie(a.position.x, a.position.y, a.position.z, a.values_hash) <
         std::tie(b.position.x, b.position.y, b.position.z, b.values_hash);
}

std::uint64_t hash_values(const PointRecords& layout, const std::byte* record) {
  if (layout.copies() == VertexCopies::same_values)
    return format::hash_bytes(layout.sample(record).subspan(layout.position_bytes()));
  std::uint64_t hash = layout.copies() == VertexCopies::same_block ? layout.block(record) : 0;
  for (std::size_t a = 0; a < layout.attributes(); ++a)
    hash = 0x9e3779b97f4a7c15u * hash + (std::isnan(layout.value(record, a)) ? 1 : 2);
  return hash;
}

BoundaryCorners::BoundaryCorners(const PointRecords& layout, ExternalSorter corners)
    : layout_(layout), sorted_(std::move(corners)), record_(layout.bytes()) {}

Result<bool> BoundaryCorners::peek() {
  if (next_ == read_.keys.size()) {
    SPLATVOL_TRY_SET(read_, sorted_.next());
    next_ = 0;
  }
  return !read_.keys.empty();
}

// Reads the corners of this key, and skips those before.
Status BoundaryCorners::read_corners(const MortonKey& key) {
  corners_.clear();
  for (;;) {
    SPLATVOL_TRY_ASSIGN(any, peek());
    if (!any || read_.keys[next_] > key) break;
    if (read_.keys[next_] == key) corners_.push_back(record_at<CornerArea>(read_.records, next_));
    ++next_;
  }
  std::ranges::stable_sort(corners_, {}, &CornerArea::face);
  return {};
}

Status BoundaryCorners::append_planes(PointBatch& batch, std::size_t begin, std::span<const std::size_t> stored,
                                      std::span<const std::uint64_t> blocks) {
  batch.planes.resize(batch.size());
  for (std::size_t first = begin, end = begin; first < batch.size(); first = end) {
    while (end < batch.size() && batch.keys[end] == batch.keys[first]) ++end;
    SPLATVOL_TRY(read_corners(batch.keys[first]));
    for (std::size_t i = first; i < end && !corners_.empty(); ++i) {
      layout_.set_position(record_.data(), batch.positions[i]);
      if (layout_.copies() == VertexCopies::same_block) layout_.set_block(record_.data(), blocks[i - begin]);
      for (std::size_t a = 0; a < layout_.attributes(); ++a)
        layout_.set_value(record_.data(), a, batch.values[stored[a]][i]);
      const Corner corner{batch.positions[i], hash_values(layout_, record_.data())};
      incident_.clear();
      for (const CornerArea& third : corners_)
        if (third.corner == corner) incident_.push_back(third.plane);
      batch.planes[i] = merge_planes(incident_, std::vector<dvec3>(incident_.size(), dvec3(0)));
    }
  }
  return {};
}

}  // namespace splatvol
