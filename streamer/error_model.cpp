#include "streamer/error_model.h"

#include <algorithm>
#include <cmath>

namespace splatvol {
namespace {

// Against the true error on the scenes of docs/accuracy.md.
constexpr double calibration = 1.0 / 72;

constexpr double shape_share = 1.0 / 300;
constexpr double seam_share = 1.0 / 200;
constexpr double smallest_pixels = 0.5;  // splats of this width show half of their error

// Of a cell that is partly out of sight, at least this share counts: its splats reach out of it.
constexpr double smallest_share_in_view = 0.01;
constexpr int samples_along_edge = 4;

}  // namespace

ErrorModel::ErrorModel(const NodeTree& tree) : tree_(tree) {}

ErrorModel::Footprint ErrorModel::footprint_of(const Cube& cell) const {
  const View& view = tree_.view();
  const auto scale_at = [&](double depth) {
    return view.orthographic ? view.focal : view.focal / std::max(depth, 0.1 * cell.edge);
  };
  const auto inside = [&](const dvec3& p, double scale, double margin) {
    return p.z > 0 && std::abs(p.x) * scale + margin < 0.5 * view.width &&
           std::abs(p.y) * scale + margin < 0.5 * view.height;
  };
  const double largest_area = 1.0 * view.width * view.height;
  const dvec3 centre = view.to_view(cell.origin + 0.5 * cell.edge);
  double scale = scale_at(centre.z);
  if ((view.orthographic || centre.z > 4 * cell.edge) && inside(centre, scale, 1.3 * cell.edge * scale))
    return {std::min(cell.edge * cell.edge * scale * scale, largest_area), scale};

  // Near, or at the picture's border.
  constexpr int n = samples_along_edge;
  double squares = 0, squares_in_view = 0;
  for (int i = 0; i < n * n * n; ++i) {
    const dvec3 share = (dvec3(i % n, i / n % n, i / (n * n)) + 0.5) / double{n};
    const dvec3 p = view.to_view(cell.origin + cell.edge * share);
    scale = scale_at(p.z);
    squares += scale * scale;
    if (inside(p, scale, 0)) squares_in_view += scale * scale;
  }
  squares /= n * n * n;
  squares_in_view = std::max(squares_in_view / (n * n * n), smallest_share_in_view * squares);
  return {std::min(cell.edge * cell.edge * squares_in_view, largest_area), std::sqrt(squares)};
}

void ErrorModel::evaluate(const Node& node, std::span<float> errors, std::span<float> seams) const {
  std::ranges::fill(errors, 0.0F);
  std::ranges::fill(seams, 0.0F);
  const View& view = tree_.view();
  const double edge = node.cell.edge;
  const Footprint footprint = footprint_of(node.cell);
  const ValueContrast::Node values = tree_.visibility().contrast().of(node.summary());
  const double scaling = calibration / (3.0 * view.width * view.height);
  for (std::size_t r = node.first_resolution(); r <= tree_.finest(); ++r) {
    if (!tree_.is_within_reach(node, r)) continue;
    const double count = std::max<double>(1, static_cast<double>(node.splat_count(r)));
    const double bound = std::min(tree_.splat_bound(node, r), 4 * edge);
    const double width = std::min(std::cbrt(edge * edge * bound / std::cbrt(count * count)), edge);
    const double pixels_squared = width * width * footprint.scale * footprint.scale;
    const double damping = 1 + values.extinction * width;
    const double geometry = scaling * footprint.area * edge * width / (damping * damping) * pixels_squared /
                            (pixels_squared + smallest_pixels * smallest_pixels);
    const double contrast = values.variance(width / edge);
    errors[r] = static_cast<float>(geometry * (contrast + shape_share * values.emission_squared));
    seams[r] = static_cast<float>(geometry * seam_share * values.emission_squared);
  }
}

}  // namespace splatvol
