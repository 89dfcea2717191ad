// A frame of tiles: the view's constants, records in the view, and splats on the screen. Internal to
// the tiles. Plain data, so that the code for each instruction set is the only one that computes with it.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "renderer/common.h"
#include "renderer/depth_pyramid.h"
#include "splat/record.h"

namespace splatvol::tiles {

inline constexpr int tile_size = 32;  // pixels along an edge
inline constexpr int most_lanes = 16;

inline constexpr int table_margin = 2 * most_lanes;

/// The transfer function's table, one plane for each of r, g, b and extinction. The planes of a row are next to each
/// other. Before and behind each plane are table_margin copies of its first and last entry, so that vectors may be read
/// that begin at any column.
struct TableLevel {
  const float* entries = nullptr;  // the first column of the first row
  int plane = 0;                   // from one plane to the next, in entries
};

/// Coarser levels of the table have every 2nd, 4th ... column, for splats that need many. They serve where the table
/// between their columns is almost straight.
struct TableView {
  static constexpr int level_count = 5;
  static constexpr int columns_per_block = 32;  // of level 0

  int columns = 0, rows = 0;  // with the margins of TransferTable
  std::array<TableLevel, level_count> levels;
  const float* row_spreads = nullptr;  // of each row, in units of the domain
  const float* errors = nullptr;       // [row][block][level]: the largest relative error within a block
  int blocks = 0;                      // of a row

  /// Returns the columns between the margins, less one.
  [[nodiscard]] float inner_columns() const { return static_cast<float>(columns - 1 - 2 * margin); }

  static constexpr int margin = static_cast<int>(TransferTable::margin);
};

/// Largest relative error that a coarser level may have.
inline constexpr float most_level_error = 4e-3F;

/// The mean factors of an opacity (OpacityTable).
struct OpacityView {
  StoredAxis axis;
  const float* factors = nullptr;  // [row][column]; null: there is no opacity
  int columns = 0, rows = 0;
  const float* row_spreads = nullptr;

  /// Returns the columns between the margins, less one.
  [[nodiscard]] float inner_columns() const { return static_cast<float>(columns - 1 - 2 * TableView::margin); }
};

/// The constants of a frame. View coordinates: x to the right, y up, z forwards, in drawing units, the eye at the
/// origin. Pixels count from the lower left corner.
struct FrameConstants {
  std::array<float, 9> rotation{};  // rows: from world directions to view coordinates
  float width = 0, height = 0;      // pixels
  float focal = 1;                  // pixels (perspective), or pixels per drawing unit (orthographic)
  bool orthographic = false;
  float ambient = 1, diffuse = 0;  // factor on colours: ambient + diffuse * cosine
  StoredAxis axis;
  TableView table;
  OpacityView opacity;                     // the splats have values of its attribute
  const float* peaks = nullptr;            // make_peak_levels, one level after another
  const DepthPyramid* surfaces = nullptr;  // null: there are none
};

/// A range of the draw list in the view.
struct RangeInView {
  const MomentsShape* shapes = nullptr;  // of its first record; null if the kernel is octant
  const MomentsValue* values = nullptr;
  const OctantShape* octants = nullptr;
  const OctantValue* octant_values = nullptr;
  const OpacityValue* opacities = nullptr;  // null: there are none
  std::uint32_t first = 0;                  // number of its first splat in the draw list
  std::uint32_t count = 0;
  float x = 0, y = 0, z = 0;  // origin of its block, view coordinates
  float step = 0;
  float mass_scale = 0;  // with the unit of coverage
  float deviation_scale = 0;
  float value_deviation_scale = 0;
  float opacity_deviation_scale = 0;
};

/// By what splats are sorted.
enum class SortKey {
  distance,  // to the eye; depth in orthographic projection
  depth,
};

inline constexpr unsigned splats_per_group = 16;

/// The splats of a draw list by number. Every range has splats.
struct SplatNumbers {
  std::span<const RangeInView> ranges;
  std::span<const std::uint32_t> first_ranges;  // [number / splats_per_group]: the range of the group's first splat

  [[nodiscard]] const RangeInView& range_of(std::uint32_t number) const {
    std::size_t i = first_ranges[number / splats_per_group];
    while (number - ranges[i].first >= ranges[i].count) ++i;
    return ranges[i];
  }
};

/// Pixels [left, right) x [bottom, top) that a splat may touch; empty if left == right.
struct PixelBounds {
  std::uint16_t left = 0, bottom = 0, right = 0, top = 0;
};

/// Where a splat is drawn: pixel (x, y) + s.x (width, skew) + s.y (0, height), where s.x and s.y lie in [-reach, reach]
/// and 1 - s^2 is positive. Polynomials have the variables v, the height over the centre, and t. In a row of pixels, t
/// counts from the pixel with the smallest s^2. In other words, 1 - s^2 = 1 - v^2 inverse_height2 - t^2 inverse_width2.
struct EllipseOutline {
  float x, y;             // centre, pixels
  float reach;            // negative for a box: all pixels of the bounds are drawn, and t counts from the centre
  float shear;            // pixels from the centre to t = 0, by v
  float inverse_width2;   // of the half width in the row through the centre; 0: a box
  float inverse_height2;  // of the half height; 0: a box
  float by_width, by_height, skew;  // 1 / width, 1 / height
};

/// A splat of the kernel moments that is far away (docs/design.md): polynomials of (t, v) with the coefficients of 1,
/// t, v, t^2, t v, v^2. Fills two cache lines.
struct alignas(64) FarSplat {
  EllipseOutline outline;
  std::array<float, 6> depth;    // optical depth at an extinction and 1 - s^2 of 1
  std::array<float, 6> column;   // of the table, in the middle of the chord
  float light;                   // factor on the colours
  float along;                   // columns from the middle to the end of the chord, at 1 - s^2 of 1; 0: no boundary
  std::array<float, 3> cutting;  // linear: where the boundary cuts the chord, times sqrt(1 - s^2)
  std::int32_t row;              // of the table: number of its first entry
  float column_reach;            // columns lie at most so far from column[0]
};
static_assert(sizeof(FarSplat) == 128);

/// A vector that is linear in (t, v).
struct LinearVector {
  std::array<float, 3> constant, by_t, by_v;
};

/// Any splat of the kernel moments, with the eye beside or inside it: rays o + k d in the coordinates in which the
/// ellipsoid is the unit ball.
struct NearSplat {
  EllipseOutline outline;
  LinearVector direction;      // d
  std::array<float, 3> along;  // o . d: of 1, t, v
  LinearVector moment;         // o x d
  float strength;              // optical depth at an extinction, |d|, length of d and 1 - b^2 of 1
  float mean, residual;        // of the value at the centre; variance that the linear field leaves
  std::array<float, 3> gradient;
  float inverse_slope;          // for the light; 0: no gradient
  std::array<float, 3> normal;  // of the boundary; 0: none
  float stretch;
  float spread, light;  // of all pixels, for an ellipse; negative: each pixel has its own
  float inverse_depth;  // 1 / depth of k = 1
};
static_assert(sizeof(NearSplat) == 176);

/// A splat of the kernel octant: a round Gaussian, whose alpha falls as 2^-(distance^2).
struct GaussianSplat {
  float x, y;     // centre, pixels
  float scale;    // a pixel in half widths at half maximum
  float r, g, b;  // premultiplied, at the centre
  float alpha;
};
static_assert(sizeof(GaussianSplat) == 28);

enum class Form : std::uint8_t {
  none,
  far,
  near,
  partial,  // a near splat, of which surfaces may hide a part
  gaussian,
};

/// Splats of a batch on the screen, by their slots. A slot has its data in the array of its form.
struct ScreenSplats {
  PixelBounds* bounds = nullptr;
  Form* forms = nullptr;
  FarSplat* far = nullptr;
  NearSplat* near = nullptr;
  GaussianSplat* gaussians = nullptr;
  float* depths = nullptr;  // of Gaussians, as far as surfaces may hide them, else negative; null: no surfaces

  [[nodiscard]] ScreenSplats from(std::size_t slot) const {
    return {bounds + slot,
            forms + slot,
            far ? far + slot : nullptr,
            near ? near + slot : nullptr,
            gaussians ? gaussians + slot : nullptr,
            depths ? depths + slot : nullptr};
  }
};

/// The pixels of a tile while splats are blended, front to back. Rows are longer than tiles, so that vectors may begin
/// at any pixel. A row follows the last plane, so that two rows may be read and written together from any row on.
struct TilePixels {
  static constexpr int row_stride = tile_size + most_lanes;
  // Without more, two planes would lie 4 KiB apart: loads from one wait for stores to the other.
  static constexpr int plane = tile_size * row_stride + most_lanes;
  static constexpr int transmittance = 3 * plane;  // the first three planes are r, g, b, premultiplied

  alignas(64) std::array<float, 4 * plane + row_stride> values;
};

/// The transmittance of a pixel behind which nothing can be seen. It ends the tile's loop.
inline constexpr float least_transmittance = 1e-4F;

/// Where a tile lies in the picture, in pixels.
struct TileArea {
  int left = 0, bottom = 0;
  int width = tile_size, height = tile_size;
};

}  // namespace splatvol::tiles
