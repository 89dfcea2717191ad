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

template <class Table>
HWY_INLINE TableColumn column_at(const Table& table, Float column) {
  const Float at = clamp(column, 0.0F, static_cast<float>(table.columns - 1));
  const Int left = max(min(truncate(at), Int(table.columns - 2)), Int(0));
  return {left, at - to_float(left)};
}

/// Looks up any columns of the first row.
HWY_INLINE Material gather_from(const TableView& table, Float column) {
  const TableColumn at = column_at(table, column);
  const Int index = at.left;
  const auto between = [&](int plane) HWY_ATTR {
    const float* entries = table.levels[0].entries + plane * table.levels[0].plane;
    const Float left = gather(entries, index);
    return fma(gather(entries + 1, index) - left, at.share, left);
  };
  return {between(0), between(1), between(2), between(3)};
}

/// As many neighbouring columns of a row as a vector has lanes. Between two columns, the table is middle + step u with
/// u in [-1/2, 1/2].
struct TableWindow {
  std::array<Float, 4> middle, step;

  /// `column`: the first, at most table_margin beyond the table.
  HWY_INLINE TableWindow(const TableLevel& level, int row, int column) {
    const float* entries = level.entries + std::ptrdiff_t{4} * row * level.plane + column;
    for (int plane = 0; plane < 4; ++plane, entries += level.plane) {
      const Float left = load(entries);
      step[plane] = load(entries + 1) - left;
      middle[plane] = fma(step[plane], 0.5F, left);
    }
  }

  /// `column`: counted from the middle of the window's first two.
  [[nodiscard]] HWY_INLINE Material look_up(Float column) const {
    const Float rounded = column + rounding;
    return look_up(bits_as_int(rounded), column - (rounded - rounding));
  }

  /// `left`: the column to the left, from the window's first on, by its last bits.
  [[nodiscard]] HWY_INLINE Material look_up(Int left, Float u) const {
    const auto index = hn::IndicesFromVec(FloatTag(), (left & Int(lane_count() - 1)).v);
    const auto between = [&](int plane) HWY_ATTR {
      return fma(hn::TableLookupLanes(step[plane].v, index), u, hn::TableLookupLanes(middle[plane].v, index));
    };
    return {between(0), between(1), between(2), between(3)};
  }
};

HWY_INLINE Int largest_of(Int a) { return hn::MaxOfLanes(IntTag(), a.v); }
HWY_INLINE Int smallest_of(Int a) { return hn::MinOfLanes(IntTag(), a.v); }
HWY_INLINE std::int32_t first_lane(Int a) { return hn::GetLane(a.v); }

HWY_INLINE Material select(Mask mask, const Material& yes, const Material& no) {
  return {select(mask, yes.r, no.r), select(mask, yes.g, no.g), select(mask, yes.b, no.b),
          select(mask, yes.extinction, no.extinction)};
}

/// Looks up any columns of a row in the lanes of the mask: window by window, which is faster than gathering. Most often
/// one window has all of them. Other lanes get some material.
HWY_INLINE Material look_up_row(const TableView& table, int row, Float column, Mask inside) {
  const Float at = clamp(column, 0.0F, static_cast<float>(table.columns - 1));
  const Float rounded = (at - 0.5F) + rounding;
  const Float u = (at - 0.5F) - (rounded - rounding);
  const Int zero_bits = bits_as_int(Float(rounding));
  const Int left = max(min(bits_as_int(rounded) - zero_bits, Int(table.columns - 2)), Int(0));
  const Int lanes(lane_count() - 1);
  std::int32_t first = first_lane(smallest_of(select_int(inside, left, table.columns)));
  Material material = TableWindow(table.levels[0], row, first).look_up(left - Int(first), u);
  Mask rest = both(inside, mask_of(hn::Gt(left.v, (lanes + Int(first)).v)));
  while (any(rest)) {
    first = first_lane(smallest_of(select_int(rest, left, table.columns)));
    material = select(rest, TableWindow(table.levels[0], row, first).look_up(left - Int(first), u), material);
    rest = both(rest, mask_of(hn::Gt(left.v, (lanes + Int(first)).v)));
  }
  return material;
}

/// The same for a row in each lane.
HWY_INLINE Material look_up_rows(const TableView& table, Int row, Float column, Mask inside) {
  Material material{0.0F, 0.0F, 0.0F, 0.0F};
  while (any(inside)) {
    const Int some = largest_of(select_int(inside, row, -1));
    const Mask same = both(inside, mask_of(hn::Eq(row.v, some.v)));
    material = select(same, look_up_row(table, first_lane(some), column, same), material);
    inside = hn::AndNot(same, inside);
  }
  return material;
}

/// Where the lanes of a vector are in a tile, from its first pixel on.
struct LanePixels {
  Float x, y;
  int rows;
};

template <bool paired>
HWY_INLINE LanePixels lane_pixels() {
  if constexpr (!paired) return {lane_numbers(), 0.0F, 1};
  const int half_count = lane_count() / 2;
  const Float half(static_cast<float>(half_count));
  const Float y = select(lane_numbers() < half, 0.0F, 1.0F);
  return {lane_numbers() - y * half, y, 2};
}

using HalfTag = hn::Half<FloatTag>;

/// Read and write a vector of pixels: neighbours in a row, or if `paired`, half a vector in each of two rows.
template <bool paired>
HWY_INLINE Float load_pixels(const float* pixels) {
  if constexpr (!paired) return load(pixels);
  const auto lower = hn::LoadU(HalfTag(), pixels);
  return hn::Combine(FloatTag(), hn::LoadU(HalfTag(), pixels + TilePixels::row_stride), lower);
}
template <bool paired>
HWY_INLINE void store_pixels(Float numbers, float* pixels) {
  if constexpr (!paired) return store(numbers, pixels);
  hn::StoreU(hn::LowerHalf(HalfTag(), numbers.v), HalfTag(), pixels);
  hn::StoreU(hn::UpperHalf(HalfTag(), numbers.v), HalfTag(), pixels + TilePixels::row_stride);
}

/// Puts material of this alpha behind what the pixels hold.
template <bool paired = false>
HWY_INLINE void blend(Float alpha, Float light, const Material& material, float* pixels) {
  float* transmittances = pixels + TilePixels::transmittance;
  const Float transmittance = load_pixels<paired>(transmittances);
  const Float seen = transmittance * alpha, lit = seen * light;
  const auto add = [lit](Float color, float* to)
                       HWY_ATTR { store_pixels<paired>(fma(lit, color, load_pixels<paired>(to)), to); };
  add(material.r, pixels);
  add(material.g, pixels + TilePixels::plane);
  add(material.b, pixels + 2 * TilePixels::plane);
  store_pixels<paired>(transmittance - seen, transmittances);
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
