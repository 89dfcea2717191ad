// Blending into a tile's pixels, and looking up the transfer table. Included once for each instruction set.
#if defined(SPLATVOL_RENDERER_CPU_BLEND_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef SPLATVOL_RENDERER_CPU_BLEND_INL_H
#undef SPLATVOL_RENDERER_CPU_BLEND_INL_H
#else
#define SPLATVOL_RENDERER_CPU_BLEND_INL_H
#endif

#include "renderer/cpu/vector-inl.h"

HWY_BEFORE_NAMESPACE();
namespace splatvol::tiles::HWY_NAMESPACE {

struct Material {
  Float r, g, b, extinction;
};

/// A column of the table between two entries.
struct TableColumn {
  Int left;
  Float share;  // of the entry to the right
};

HWY_INLINE TableColumn column_at(const TableView& table, Float column) {
  const Float at = clamp(column, 0.0F, static_cast<float>(table.columns - 1));
  const Int left = max(min(truncate(at), Int(table.columns - 2)), Int(0));
  return {left, at - to_float(left)};
}

/// Looks up the table. `row`: number of the row's first entry, one in each lane.
HWY_INLINE Material gather_from(const TableView& table, Int row, Float column) {
  const TableColumn at = column_at(table, column);
  const Int index = row + at.left;
  const auto between = [&](int plane) HWY_ATTR {
    const float* entries = table.entries + plane * table.plane;
    const Float left = gather(entries, index);
    return fma(gather(entries + 1, index) - left, at.share, left);
  };
  return {between(0), between(1), between(2), between(3)};
}

/// As many columns of a row as a vector has lanes: registers hold them.
class TableWindow {
 public:
  HWY_INLINE TableWindow(const TableView& table, std::int32_t row) : table_(&table), row_(row) {}

  /// Whether a window holds all columns between two.
  [[nodiscard]] HWY_INLINE bool fits(float low, float high) const {
    const float last = static_cast<float>(table_->columns - 1);
    return std::min(high, last) - std::floor(std::max(low, 0.0F)) < static_cast<float>(lane_count());
  }

  /// Returns the window that begins at a column.
  [[nodiscard]] HWY_INLINE TableWindow at(float low) const {
    TableWindow window = *this;
    window.first_ = static_cast<std::int32_t>(std::clamp(low, 0.0F, static_cast<float>(table_->columns - 2)));
    for (int plane = 0; plane < 4; ++plane) {
      const float* entries = table_->entries + row_ + plane * table_->plane + window.first_;
      window.left_[plane] = load(entries);
      window.step_[plane] = load(entries + 1) - window.left_[plane];
    }
    return window;
  }

  /// Requires columns of the window. Others give any entry of it.
  [[nodiscard]] HWY_INLINE Material look_up(Float column) const {
    const TableColumn at = column_at(*table_, column);
    const auto index = hn::IndicesFromVec(FloatTag(), ((at.left - Int(first_)) & Int(lane_count() - 1)).v);
    const auto between = [&](int plane) HWY_ATTR {
      return fma(hn::TableLookupLanes(step_[plane].v, index), at.share, hn::TableLookupLanes(left_[plane].v, index));
    };
    return {between(0), between(1), between(2), between(3)};
  }

  [[nodiscard]] HWY_INLINE Material gather_at(Float column) const { return gather_from(*table_, Int(row_), column); }

 private:
  const TableView* table_;
  std::int32_t row_;
  std::int32_t first_ = 0;
  std::array<Float, 4> left_, step_;
};

/// Puts material of this alpha behind what the pixels hold.
HWY_INLINE void blend(Float alpha, Float light, const Material& material, float* pixels) {
  float* transmittances = pixels + TilePixels::transmittance;
  const Float transmittance = load(transmittances);
  const Float seen = transmittance * alpha, lit = seen * light;
  store(fma(lit, material.r, load(pixels)), pixels);
  store(fma(lit, material.g, load(pixels + TilePixels::plane)), pixels + TilePixels::plane);
  store(fma(lit, material.b, load(pixels + 2 * TilePixels::plane)), pixels + 2 * TilePixels::plane);
  store(transmittance - seen, transmittances);
}

/// Whether nothing behind the tile's pixels can be seen.
HWY_INLINE bool is_opaque(const TileArea& area, const TilePixels& pixels) {
  const float* transmittances = pixels.values.data() + TilePixels::transmittance;
  for (int y = 0; y < area.height; ++y)
    for (int x = 0; x < area.width; x += lane_count()) {
      const Mask inside = lane_numbers() < Float(static_cast<float>(area.width - x));
      if (any(both(inside, load(transmittances + y * TilePixels::row_stride + x) > Float(least_transmittance))))
        return false;
    }
  return true;
}

}  // namespace splatvol::tiles::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
