#include "renderer/reference/slice.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>

#include "renderer/reference/cell.h"

namespace splatvol {
namespace {

constexpr int band_rows = 16;

// A cell ends a little later than computed: neighbours leave no gap between them.
constexpr double cell_margin = 1e-9, depth_margin = 1e-13;

struct CutCell {
  CellCorners corners;  // view coordinates
  std::array<double, 4> values;
  PixelRectangle bounds;
};

class CellsOnPlane {
 public:
  CellsOnPlane(const TetMesh& mesh, const View& view, const Plane& plane) : view_(view) {
    for (std::size_t cell = 0; cell < mesh.tetrahedra.size(); ++cell) add(mesh, plane, cell);
  }

  // Sets the values of some rows of pixels. Rows count from the lowest.
  void draw_rows(int first, int last, std::span<const double> depths, std::vector<double>& values) const {
    for (const CutCell& cell : cells_) {
      const int begin = std::max(first, cell.bounds.y0), end = std::min(last, cell.bounds.y1);
      if (begin > end) continue;
      CellCrosser crosser(view_.orthographic, cell.corners, cell.values);
      for (int y = begin; y <= end; ++y) {
        if (!crosser.select_row(pixel_ray(view_, 0, y).b)) continue;
        for (int x = cell.bounds.x0; x <= cell.bounds.x1; ++x) {
          const std::size_t pixel = static_cast<std::size_t>(view_.height - 1 - y) * view_.width + x;
          if (!(depths[pixel] < std::numeric_limits<double>::infinity()) || !std::isnan(values[pixel])) continue;
          if (const auto crossing = crosser.cross(pixel_ray(view_, x, y).a))
            values[pixel] = value_at(*crossing, depths[pixel]);
        }
      }
    }
  }

 private:
  void add(const TetMesh& mesh, const Plane& plane, std::size_t cell) {
    CutCell cut;
    bool before = false, behind = false;
    for (std::size_t i = 0; i < 4; ++i) {
      const std::uint32_t point = mesh.tetrahedra[cell][i];
      const dvec3& position = mesh.points[point];
      const double distance = plane.distance(position);
      cut.values[i] = mesh.values[mesh.constant ? cell : point];
      if (!std::isfinite(cut.values[i]) || !std::isfinite(distance)) return;
      before = before || distance <= 0;
      behind = behind || distance >= 0;
      cut.corners[i] = view_.to_view(position);
    }
    if (!before || !behind) return;
    cut.bounds = pixel_bounds(view_, cut.corners);
    if (!cut.bounds.is_empty()) cells_.push_back(cut);
  }

  static double value_at(const Crossing& crossing, double depth) {
    const double length = crossing.leave - crossing.enter, margin = cell_margin * length + depth_margin * depth;
    if (depth < crossing.enter - margin || depth > crossing.leave + margin)
      return std::numeric_limits<double>::quiet_NaN();
    const double share = length > 0 ? std::clamp((depth - crossing.enter) / length, 0.0, 1.0) : 0;
    return crossing.value_enter + share * (crossing.value_leave - crossing.value_enter);
  }

  const View& view_;
  std::vector<CutCell> cells_;
};

}  // namespace

Result<std::vector<double>> exact_slice(const TetMesh& mesh, const View& view, const Plane& plane,
                                        std::span<const double> depths) {
  SPLATVOL_TRY(check_mesh(mesh));
  if (depths.size() != static_cast<std::size_t>(view.width) * view.height)
    return fail(ErrorCode::invalid_argument, "{} depths of a slice for {} x {} pixels", depths.size(), view.width,
                view.height);
  const CellsOnPlane cells(mesh, view, plane);
  std::vector<double> values(depths.size(), std::numeric_limits<double>::quiet_NaN());
  tbb::parallel_for(tbb::blocked_range<int>(0, view.height, band_rows), [&](const tbb::blocked_range<int>& rows) {
    cells.draw_rows(rows.begin(), rows.end() - 1, depths, values);
  });
  return values;
}

}  // namespace splatvol
