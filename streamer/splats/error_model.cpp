#include "streamer/splats/error_model.h"

#include <algorithm>
#include <cmath>
#include <span>

namespace splatvol {
namespace {

// Fitted to the true error on the scenes of docs/accuracy.md.
constexpr double calibration = 1.0 / 110;

constexpr double shape_share = 1.0 / 50;
constexpr double seam_share = 1.0 / 200;
constexpr double slice_share = 10;       // of the contrast on slices
constexpr double smallest_pixels = 0.5;  // splats of this width show half of their error

// At least this share of a node counts, even if less is in view: its splats reach out of its cube.
constexpr double smallest_share_in_view = 0.01;

// Sums of such errors stay in the range of single precision.
constexpr double largest_error = 1e30;

struct Footprint {
  double area;   // pixels that a section of the cube covers
  double scale;  // pixels per world unit
};

Footprint footprint_of(const View& view, const Cube& cube, std::span<const dvec3> samples) {
  const auto scale_at = [&](double depth) {
    return view.orthographic ? view.focal : view.focal / std::max(depth, 0.1 * cube.edge);
  };
  const auto inside = [&](const dvec3& p, double scale, double margin) {
    return p.z > 0 && std::abs(p.x) * scale + margin < 0.5 * view.width &&
           std::abs(p.y) * scale + margin < 0.5 * view.height;
  };
  const double largest_area = 1.0 * view.width * view.height;
  const dvec3 center = view.to_view(cube.origin + 0.5 * cube.edge);
  double scale = scale_at(center.z);
  if ((view.orthographic || center.z > 4 * cube.edge) && inside(center, scale, 1.3 * cube.edge * scale))
    return {std::min(cube.edge * cube.edge * scale * scale, largest_area), scale};

  // Near the eye, or at the border of the picture.
  double squares = 0, squares_in_view = 0;
  for (const dvec3& sample : samples) {
    const dvec3 p = center + cube.edge * sample;
    scale = scale_at(p.z);
    squares += scale * scale;
    if (inside(p, scale, 0)) squares_in_view += scale * scale;
  }
  const auto count = static_cast<double>(samples.size());
  squares /= count;
  squares_in_view = std::max(squares_in_view / count, smallest_share_in_view * squares);
  return {std::min(cube.edge * cube.edge * squares_in_view, largest_area), std::sqrt(squares)};
}

}  // namespace

ErrorModel::ErrorModel(const NodeTree& tree)
    : tree_(tree), scaling_(calibration / (3.0 * tree.view().width * tree.view().height)) {
  constexpr int n = samples_along_edge;
  const View& view = tree.view();
  for (int i = 0; i < n * n * n; ++i) {
    const dvec3 share = (dvec3(i % n, i / n % n, i / (n * n)) + 0.5) / double{n} - 0.5;
    samples_[static_cast<std::size_t>(i)] = {glm::dot(share, view.right), glm::dot(share, view.up),
                                             glm::dot(share, view.forward)};
  }
}

ErrorModel::OfNode::OfNode(const ErrorModel& model, const Node& node)
    : model_(model), node_(node), values_(model.tree_.visibility().contrast(node.values())) {
  if (model.tree_.visibility().slice_contrast())
    slice_values_ = model.tree_.visibility().slice_contrast()->of(node.summary());
  const Footprint footprint = footprint_of(model.tree_.view(), node.cube, model.samples_);
  area_ = footprint.area;
  pixels_per_edge_ = footprint.scale * node.cube.edge;
}

ErrorModel::Terms ErrorModel::OfNode::at(std::size_t resolution, std::uint64_t splats) const {
  const double edge = node_.cube.edge / model_.tree_.visibility().length();  // the unit of values_
  // Logarithms of single precision take a third of the time.
  const float bound = std::min(static_cast<float>(model_.tree_.splat_bound_in_cube(node_, resolution)), 2.0F);
  const float count = std::max(static_cast<float>(splats), 1.0F);
  const double share = std::min(std::exp2((bound - 2.0F / 3 * std::log2(count)) / 3), 1.0F);  // h / L
  const double pixels = share * pixels_per_edge_, pixels_squared = pixels * pixels;
  const double damping = 1 + values_.extinction() * share * edge;
  const double seen = pixels_squared / (pixels_squared + smallest_pixels * smallest_pixels);
  const double geometry = model_.scaling_ * area_ * edge * edge * share / damping * seen;
  const double slices = model_.tree_.slice_weight(node_, resolution) * slice_share * model_.scaling_ * area_ * seen *
                        slice_values_.variance(share);
  // fmin also replaces what is no number: a product of 0 and an overflow.
  return {std::fmin(geometry * (values_.variance(share) + shape_share * values_.squares()) + slices, largest_error),
          std::fmin(geometry * seam_share * values_.squares(), largest_error)};
}

}  // namespace splatvol
