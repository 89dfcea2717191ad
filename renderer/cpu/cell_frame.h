// Cells on the screen. Internal to the drawing of cells. Plain data, so that the code for each instruction set is the
// only one that computes with it.
//
// Pixels count from the picture's middle. Depths are d = 1/z - w for a w of the chunk; in orthographic projection d =
// w - z. If a chunk is flat, w is linear in the pixel: then d counts from a plane in the chunk, and knows how thick it
// is. So d is linear in the pixel on every plane, and falls with depth.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "renderer/cell_source.h"
#include "renderer/cpu/cell_function.h"
#include "renderer/cpu/frame.h"
#include "renderer/cpu/samples.h"
#include "scene/scene.h"
#include "scene/tile_grid.h"

namespace splatvol::tiles {

inline constexpr int cell_tile_side = 16;
inline constexpr int cell_tile_pixels = cell_tile_side * cell_tile_side;

/// What rays meet in cells besides matter, each with its look: contours by rising values, then slices. A ray meets a
/// contour where its value rises to that of the contour, or falls below: so a place on a face belongs to one cell.
struct CellEvents {
  enum class Coloring { own, by_attribute, by_value };  // `colors`; CellFrame::contour_colors; the transfer function

  std::vector<double> values;  // of contours
  std::vector<float> u;        // the same
  std::vector<float> opacities;
  std::array<std::vector<float>, 3> colors;  // of whole opacity
  std::vector<std::int32_t> colorings;

  // Bounds of the rounding of s on a face (ContourInCell), as shares of the largest one there. A value that double
  // precision cannot tell from that of a contour counts as higher.
  static constexpr float single_rounding = 2e-6F;
  static constexpr double rounding = 1e-13;

  [[nodiscard]] int contours() const { return static_cast<int>(values.size()); }
};

/// The constants of a picture of cells. Lengths are in the picture's unit.
struct CellFrame {
  const View* view = nullptr;
  const FunctionPieces* function = nullptr;
  double low = 0, inverse_domain = 1;  // u = (value - low) * inverse_domain - function->origin
  double middle_x = 0, middle_y = 0;   // of the picture, from the middle of pixel (0, 0)
  double nearest = 0;                  // depth: what is nearer counts as behind the eye
  double farthest_nearness = 0;        // 1/z of all chunks' farthest depth, or -z: keys count from there
  float widest = 0;                    // pixels from the middle at which a corner is far out
  float slack = 0;                     // pixels by which outlines are widened

  const DifferingBlocks* blocks = nullptr;  // only pixels in these are drawn; null: all

  // What segments have besides: null, and false, if there is none.
  const Lighting* lighting = nullptr;
  const FunctionPieces* opacity = nullptr;      // its extinctions are factors
  double opacity_low = 0, opacity_inverse = 1;  // as of the values
  std::size_t layers = 0;                       // of surfaces

  const CellEvents* events = nullptr;  // null: there are none
  Lighting contour_lighting = {};
  const FunctionPieces* contour_colors = nullptr;  // by an attribute; null: none has such colours
  double contour_low = 0, contour_inverse = 1;     // as of the values

  [[nodiscard]] bool has_shades() const { return lighting || opacity; }
  [[nodiscard]] bool has_limits() const { return layers > 0 || !view->clip.is_all(); }
};

/// All rays are moved by so many pixels. So none runs along a face, or through an edge or a vertex: it is in one of the
/// cells that meet there.
inline constexpr float ray_shift_x = 1.1e-6F, ray_shift_y = 0.7e-6F;

/// A tetrahedron on the screen. If it is precise, rays meet it in double precision (PreciseCell); then its planes have
/// no numbers, and its faces stand in the order of face_corners.
struct CellOnScreen {
  /// A plane at pixel (x, y): d + a dx + b dy is its depth, u + (e dx + f dy) z its value, for the distances from its
  /// reference. d is that of a moved ray. Two cells that share a face have the same bits here, and so the same depth
  /// and value.
  struct Face {
    float a, b, e, f, d;
  };
  struct Reference {
    float x, y, u;
  };
  std::array<Reference, 2> corners;       // 0 and 1: the references of their faces
  std::array<float, 4> others;            // x, y of corner 2 and of corner 3
  std::array<Face, 4> faces;              // those in front first
  float low, high;                        // least and largest u
  std::int32_t left, right, bottom, top;  // pixels that it may cover, from the picture's lower left corner
  std::uint8_t fronts;                    // faces in front
  std::uint8_t second;                    // bit i: face i has the reference 1
  std::uint8_t order;                     // 2 bits for each face, in the order of `faces`: its number in face_corners
  bool shows_matter, has_events;
  std::int32_t precise;  // number of its PreciseCell; -1: none
};

/// A cell of which single precision does not know the outline or the thickness, or that has a corner behind the eye or
/// far outside of the picture.
struct PreciseCell {
  std::array<dvec3, 4> corners;  // in view coordinates
  std::array<float, 4> u, o;     // of corners: the value; the opacity's attribute, if the frame has one
  float slack;                   // pixels by which its outline is widened; infinite if it has none
  bool is_behind;                // a corner is behind the eye
};

/// Another attribute in a cell, by distances from a reference: its value is at + (x dx + y dy + d dd + c) z, within its
/// corners'.
struct FieldOnScreen {
  float at, x, y, d, c, low, high;
};

/// How a cell is lit, its opacity and its colours, by distances from a reference. The cosine of the gradient with a ray
/// is |lx dx + ly dy + l0| over the ray's length for a unit of depth.
struct CellShading {
  float x, y, d;  // the reference
  FieldOnScreen opacity, color;
  float lx, ly, l0;
  bool has_gradient;
  bool has_color;  // else values are missing
};

/// A piece of a ray in a cell, or an event: then `length` is its number below 0, `u_enter` the value
/// that colours it, and `u_leave` its light.
struct CellSegment {
  float key;     // rises with the depth at which the ray enters the cell
  float length;  // as a difference of depths
  float u_enter, u_leave;
};
static_assert(sizeof(CellSegment) == 16);

/// A segment that was found while its cell was set up, at a pixel from the picture's lower left corner.
struct FoundSegment {
  CellSegment segment;
  std::int16_t x, y;
};

/// The gradient in a cell as contours have it, in view coordinates: linear between those of the points.
using NormalInCell = std::array<FieldOnScreen, 3>;

/// What rays may meet in a cell.
struct EventsOfCell {
  std::int32_t first, end;                       // contours
  std::uint32_t contour_at;                      // the first of them: in CellsOnScreen::contours
  std::uint32_t normal_at;                       // in CellsOnScreen::normals, if it has contours
  std::uint64_t slices;                          // a bit for each
  std::array<std::uint64_t, 4> slices_of_faces;  // those in which faces lie, in the order of CellOnScreen::faces

  [[nodiscard]] bool has_contours() const { return first < end; }
};

/// The values in a cell less that of a contour, as u. Both cells of a face have the same bits here.
struct ContourInCell {
  /// The values over the depth, s = u / z, or u in orthographic projection: linear in the pixel. Where single precision
  /// cannot tell its sign, double precision does.
  struct Face {
    double x, y, s, e, f;                // s at (x, y), and its slopes
    float whole_x, whole_y;              // of x and y: a whole number, and
    float rest_x, rest_y;                // the rest
    float single_s, single_e, single_f;  // as s, e, f
    float low, high;                     // least and largest u
    float largest_s;                     // in size
  };
  std::array<Face, 4> faces;  // in the order of CellOnScreen::faces
  float eye_u, eye_e, eye_f;  // on the eye's plane: u = eye_u + eye_e x + eye_f y
};

/// Cells whose memory stays when they are set up anew, and is not filled before.
class CellArray {
 public:
  /// Forgets all cells, and makes room for so many.
  void reserve(std::size_t count) {
    size_ = 0;
    if (capacity_ >= count) return;
    cells_ = std::make_unique_for_overwrite<CellOnScreen[]>(capacity_ = count);
  }
  void resize(std::size_t size) { size_ = size; }
  void clear() { size_ = 0; }

  [[nodiscard]] std::size_t size() const { return size_; }
  [[nodiscard]] std::uint64_t memory_bytes() const { return capacity_ * sizeof(CellOnScreen); }
  [[nodiscard]] CellOnScreen& operator[](std::size_t i) { return cells_[i]; }
  [[nodiscard]] const CellOnScreen& operator[](std::size_t i) const { return cells_[i]; }
  [[nodiscard]] const CellOnScreen* begin() const { return cells_.get(); }
  [[nodiscard]] const CellOnScreen* end() const { return cells_.get() + size_; }

 private:
  std::unique_ptr<CellOnScreen[]> cells_;
  std::size_t capacity_ = 0, size_ = 0;
};

/// Where d = 0 lies: w + wx (x - at_x) + wy (y - at_y) is 1/z there; in orthographic projection -z.
struct DepthOrigin {
  double w = 0, wx = 0, wy = 0;
  double at_x = 0, at_y = 0;

  /// What w is more at a pixel than at (at_x, at_y).
  [[nodiscard]] double rise(double x, double y) const { return wx * (x - at_x) + wy * (y - at_y); }
};

/// A chunk on the screen.
struct CellsOnScreen {
  DepthOrigin origin;
  float key_offset = 0;  // from d to keys, at (at_x, at_y)
  CellArray cells;
  std::vector<PreciseCell> precise;
  std::vector<CellShading> shadings;  // [cell], if the frame has shades or events
  std::vector<EventsOfCell> events;   // [cell], if the frame has events
  std::vector<ContourInCell> contours;
  std::vector<NormalInCell> normals;
  std::uint64_t slices = 0;  // that cut a cell; a bit for each

  // Cells that cover few pixels have these instead: those of one after the other.
  std::vector<FoundSegment> found;                                    // and room for more
  std::vector<std::uint32_t> found_begins = {0};                      // [cell]: into found; one more than cells
  static constexpr std::uint32_t found_bit = std::uint32_t{1} << 31;  // of the numbers of such cells

  [[nodiscard]] static bool has_found(std::uint32_t number) { return (number & found_bit) != 0; }
  [[nodiscard]] std::span<const FoundSegment> found_of(std::uint32_t number) const {
    const std::size_t cell = number & ~found_bit;
    return std::span(found).subspan(found_begins[cell], found_begins[cell + 1] - found_begins[cell]);
  }

  // The cells of each tile in a rectangle of tiles, nearest first.
  int tiles_left = 0, tiles_bottom = 0, tiles_across = 0, tiles_up = 0;
  std::vector<std::uint32_t> begins;   // [row][column]: into numbers; one more than tiles
  std::vector<std::uint32_t> numbers;  // of cells

  [[nodiscard]] std::span<const std::uint32_t> in_tile(int column, int row) const {
    column -= tiles_left, row -= tiles_bottom;
    if (column < 0 || row < 0 || column >= tiles_across || row >= tiles_up) return {};
    const std::size_t tile =
        static_cast<std::size_t>(row) * static_cast<std::size_t>(tiles_across) + static_cast<std::size_t>(column);
    return std::span(numbers).subspan(begins[tile], begins[tile + 1] - begins[tile]);
  }
  /// Returns what it takes, with the memory that stays for other cells.
  [[nodiscard]] std::uint64_t memory_bytes() const {
    const auto bytes_of = [](const auto& all) { return all.capacity() * sizeof(all[0]); };
    return cells.memory_bytes() + bytes_of(precise) + bytes_of(shadings) + bytes_of(events) + bytes_of(contours) +
           bytes_of(normals) + bytes_of(found) + bytes_of(found_begins) + bytes_of(begins) + bytes_of(numbers);
  }
  void clear() {
    cells.clear();
    precise.clear();
    shadings.clear();
    events.clear();
    contours.clear();
    normals.clear();
    found_begins.assign(1, 0);
    slices = 0;
    tiles_across = tiles_up = 0;
  }
};

struct PointsOnScreen {
  struct Place {
    float x, y, d, w;
  };
  std::vector<Place> places;
  std::vector<float> u;
  std::vector<std::int32_t> is_far_out;
  bool has_far_out = false;  // one of the points is
};

/// The first and the last tiles that a cell may cover, across and up.
struct TileBounds {
  std::uint16_t left, right, bottom, top;
};

/// What setting up a chunk needs. Kept between chunks for its memory.
struct CellSetup {
  std::vector<dvec3> in_view;
  PointsOnScreen points;
  std::vector<std::int32_t> seen;       // numbers of tetrahedra
  std::vector<std::uint8_t> is_used;    // [point]: whether one of these has it
  std::vector<std::int32_t> numbers;    // of screen.cells: the tetrahedron
  std::vector<TileBounds> tiles;        // of screen.cells
  std::vector<TileBounds> found_tiles;  // of cells whose segments are found
  std::vector<float> opacities;         // as points.u
  std::vector<float> colors;            // as points.u, of the attribute that colours contours

  // Slices: bits of those that a point is on one side of, or on both if it is on the slice.
  struct Sides {
    std::uint64_t before, behind;
  };
  std::vector<Sides> sides;          // [point]; empty: no slice cuts the chunk
  std::vector<std::int32_t> is_cut;  // [tetrahedron], with more behind; empty: as `sides`
  std::vector<std::uint64_t> keys;   // of cells: nearer ones have lower keys; the cell's number below
  std::vector<std::uint64_t> sorted;
  std::vector<std::uint32_t> next;  // [tile]
};

/// The largest d, in size.
inline constexpr float farthest = 1e30F;

/// Returns a value as u. NaN stays.
inline float u_of(double value, double low, double inverse_domain, double origin) {
  constexpr double largest = 1e28;
  const double u = (value - low) * inverse_domain - origin;
  return static_cast<float>(std::isnan(u) ? u : std::clamp(u, -largest, largest));
}

/// Finds the tetrahedra that slices cut: setup.sides and setup.is_cut. `box`: round the chunk, in world coordinates.
void cut_by_slices(const CellFrame& frame, const Box& box, const Tetrahedra& cells, CellSetup& setup);

/// Set setup.points.u, setup.opacities and setup.colors.
void place_values(const CellFrame& frame, const Tetrahedra& cells, CellSetup& setup);

/// Lists the cells of a chunk with a visible value, or with an event: setup.seen. Requires setup.points.u and
/// setup.is_cut.
void list_seen_cells(const CellFrame& frame, const Tetrahedra& cells, CellSetup& setup);

/// Places the points of these: setup.in_view, the rest of setup.points, and what `screen` has of depths. `box`: round
/// the chunk, in view coordinates.
void place_points(const CellFrame& frame, const Box& box, const Tetrahedra& cells, CellSetup& setup,
                  CellsOnScreen& screen);

/// Sets them up: screen.cells, screen.precise, screen.found and setup.keys. Drops those that cover no pixel from
/// setup.seen. Requires setup.in_view, setup.points, and what `screen` has of depths.
void set_up_cells(const CellFrame& frame, const Tetrahedra& cells, CellSetup& setup, CellsOnScreen& screen);

/// The faces of a cell: that of corners 0, 1, 2; of 0, 1, 3; of 0, 2, 3; of 1, 2, 3.
inline constexpr std::array<std::array<std::uint8_t, 4>, 4> face_corners = {
    {{0, 1, 2, 3}, {0, 1, 3, 2}, {0, 2, 3, 1}, {1, 2, 3, 0}}};  // the corner opposite comes last

/// Sets up a cell that rays meet in double precision. `u`: of its corners; `opacities`: the same of the opacity's
/// attribute. Returns false if it covers nothing.
bool set_up_precise(const CellFrame& frame, const std::array<std::uint32_t, 4>& corners, const CellSetup& setup,
                    const std::array<float, 4>& u, const std::array<float, 4>& opacities, CellOnScreen& cell,
                    CellsOnScreen& screen);

/// Returns a cell's values less that of a contour. `u`: these values at its corners.
ContourInCell contour_in(const CellFrame& frame, const std::array<std::uint32_t, 4>& corners, const CellSetup& setup,
                         const CellOnScreen& cell, const std::array<float, 4>& u);

/// Sets screen.events, and what cells show. Requires events in the frame.
void find_events(const CellFrame& frame, const Tetrahedra& cells, const CellSetup& setup, CellsOnScreen& screen);

/// Sets screen.shadings and screen.normals. `gradients`: at the points, in world coordinates, if screen.normals has
/// some. Requires screen.events if the frame has events.
void shade_cells(const CellFrame& frame, const Tetrahedra& cells, std::span<const dvec3> gradients,
                 const CellSetup& setup, CellsOnScreen& screen);

/// Lists the cells of each tile, nearest first.
void sort_into_tiles(CellSetup& setup, CellsOnScreen& screen);

/// What a segment has besides if the frame has shades.
struct SegmentShade {
  float lighting;          // factor on colours
  float o_enter, o_leave;  // of the opacity's attribute, as u
  float spare;
};
static_assert(sizeof(SegmentShade) == sizeof(CellSegment));

/// Where a tile lies, and which of its pixels are drawn: some rows, or a part of one.
struct CellTileArea {
  int left, bottom;
  PixelRectangle pixels;                    // from the tile's corner
  const std::uint8_t* is_wanted = nullptr;  // [pixel]: whether it is drawn, 0 or 1; null: all are

  [[nodiscard]] bool wants(std::size_t pixel) const { return !is_wanted || is_wanted[pixel] != 0; }
  [[nodiscard]] PixelRectangle in_picture() const {
    return {left + pixels.x0, left + pixels.x1, bottom + pixels.y0, bottom + pixels.y1};
  }
  [[nodiscard]] std::size_t first_pixel() const { return number_of(pixels.x0, pixels.y0); }
  [[nodiscard]] std::size_t last_pixel() const { return number_of(pixels.x1, pixels.y1); }
  [[nodiscard]] static std::size_t number_of(int column, int row) {
    return static_cast<std::size_t>(row * cell_tile_side + column);
  }
};

/// The light of a tile's pixels.
struct CellTileLight {
  alignas(64) std::array<std::array<float, cell_tile_pixels>, 3> color;  // premultiplied
  alignas(64) std::array<float, cell_tile_pixels> transmittance;
  alignas(64) std::array<std::int32_t, cell_tile_pixels> layers;                 // how many are blended
  alignas(64) std::array<std::array<std::int32_t, cell_tile_pixels>, 2> slices;  // a bit for each that is blended
};

struct CellTileLayer {
  alignas(64) std::array<float, cell_tile_pixels> keys;                  // no segment behind it has a lower one
  alignas(64) std::array<std::array<float, cell_tile_pixels>, 4> light;  // premultiplied; opacity
};

/// The segments of a tile: `room` places for each pixel that is drawn. Kept between tiles for its memory.
struct TileSegments {
  /// A segment of each of some pixels.
  struct alignas(64) Row {
    std::array<float, most_lanes> keys;
    std::array<std::int32_t, most_lanes> places;  // in `segments`, in floats
  };

  static constexpr int least_room = 68;  // no power of two: the cache has places for neighbours
  int room = least_room;
  std::size_t first_pixel = 0, pixels = 0;
  std::vector<CellSegment> segments;
  alignas(64) std::array<std::int32_t, cell_tile_pixels> counts{};
  alignas(64) std::array<std::int32_t, cell_tile_pixels + 2 * most_lanes> covered;  // pixels of a cell
  std::vector<SegmentShade> shades;  // [segment], if the frame has shades

  // If the frame has limits. [limit][pixel]: d of the chunk, from near to far: where the clip region begins, layers,
  // and where it ends.
  struct alignas(64) Limits {
    std::array<float, cell_tile_pixels> d;
  };
  std::vector<Limits> limits;
  alignas(64) std::array<float, cell_tile_pixels> end_keys;  // [pixel]: no visible segment has a higher key
  std::vector<CellTileLayer> layers;                         // and one behind all, which no ray reaches
  std::vector<Limits> slices;                                // [slice][pixel]: d of the chunk, where the ray meets it

  std::vector<Row> rows;    // by ascending keys
  std::uint64_t added = 0;  // segments
  bool is_full = false;
  std::uint64_t most_bytes = 0;  // that it may take

  /// Forgets all segments.
  void begin(const CellTileArea& area, bool has_shades);
  [[nodiscard]] std::size_t begin_of(std::size_t pixel) const {
    return (pixel - first_pixel) * static_cast<std::size_t>(room);
  }
  [[nodiscard]] std::uint64_t count() const;
  /// Makes room for twice as many. Returns false, and sets is_full, if these would take too many bytes.
  bool make_room();
};

/// Adds the segments of cells. `numbers`: of cells of `screen` that may cover the tile. `first_key`: no segment gets a
/// lower one.
void add_segments(const CellFrame& frame, const CellsOnScreen& screen, std::span<const std::uint32_t> numbers,
                  const CellTileArea& area, float first_key, TileSegments& tile);

/// Adds the light of all segments whose key is below `end`, with that of the layers in front of them and of `end`, and
/// drops the segments. Returns whether more can be seen.
bool blend_segments(const CellFrame& frame, const CellTileArea& area, float end, TileSegments& tile,
                    CellTileLight& light);

}  // namespace splatvol::tiles
