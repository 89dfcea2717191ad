#include "sampler/tetrahedron_cut.h"

#include <cmath>
#include <cstddef>
#include <limits>

namespace splatvol {
namespace {

// Returns the value of a linear function at weights; 0 where rounding may have made the difference.
double linear_at(const std::array<double, 4>& corners, const CornerWeights& weights) {
  double sum = 0, size = 0;
  for (std::size_t k = 0; k < 4; ++k) {
    sum += weights[k] * corners[k];
    size += weights[k] * std::abs(corners[k]);
  }
  return std::abs(sum) > 8 * std::numeric_limits<double>::epsilon() * size ? sum : 0;
}

// Where an edge leaves the positive side.
struct Crossing {
  CornerWeights at;
  double way, rest;  // shares of the edge on the positive side and on the other
};

// Appends what a cut leaves of one part.
class PartCut {
 public:
  PartCut(const TetrahedronPart& part, const std::array<double, 4>& values, std::vector<TetrahedronPart>& left)
      : part_(part), values_(values), left_(left) {
    for (std::size_t k = 0; k < 4; ++k)
      if (values[k] > 0) order_[inside_++] = k;
    std::size_t end = inside_;
    for (std::size_t k = 0; k < 4; ++k)
      if (!(values[k] > 0)) order_[end++] = k;
  }

  // A corner is left, or a prism, in three tetrahedra. Their shares are determinants of the weights.
  void append() const {
    if (inside_ == 1) {
      const Crossing b = cross(0, 1), c = cross(0, 2), d = cross(0, 3);
      add({vertex(0), b.at, c.at, d.at}, b.way * c.way * d.way);
    }
    if (inside_ == 2) {
      const Crossing ac = cross(0, 2), ad = cross(0, 3), bc = cross(1, 2), bd = cross(1, 3);
      add({vertex(0), ac.at, ad.at, vertex(1)}, ac.way * ad.way);
      add({ac.at, ad.at, vertex(1), bc.at}, ac.rest * ad.way * bc.way);
      add({ad.at, vertex(1), bc.at, bd.at}, ad.rest * bc.way * bd.way);
    }
    if (inside_ == 3) {
      const Crossing a = cross(0, 3), b = cross(1, 3), c = cross(2, 3);
      add({vertex(0), vertex(1), vertex(2), a.at}, a.way);
      add({vertex(1), vertex(2), a.at, b.at}, a.rest * b.way);
      add({vertex(2), a.at, b.at, c.at}, a.rest * b.rest * c.way);
    }
    if (inside_ == 4) left_.push_back(part_);
  }

 private:
  [[nodiscard]] const CornerWeights& vertex(std::size_t i) const { return part_.vertices[order_[i]]; }

  [[nodiscard]] Crossing cross(std::size_t from, std::size_t to) const {
    const double positive = values_[order_[from]], negative = values_[order_[to]], height = positive - negative;
    Crossing crossing{{}, positive / height, -negative / height};
    for (std::size_t k = 0; k < 4; ++k) crossing.at[k] = crossing.rest * vertex(from)[k] + crossing.way * vertex(to)[k];
    return crossing;
  }

  void add(const std::array<CornerWeights, 4>& vertices, double share) const {
    if (part_.share * share > 0) left_.push_back({vertices, part_.share * share});
  }

  const TetrahedronPart& part_;
  const std::array<double, 4>& values_;
  std::vector<TetrahedronPart>& left_;
  std::array<std::size_t, 4> order_{};  // vertices on the positive side, then the others
  std::size_t inside_ = 0;
};

}  // namespace

TetrahedronPart whole_tetrahedron() { return {{{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}, {0, 0, 0, 1}}}, 1}; }

CornerWeights centroid_of(const TetrahedronPart& part) {
  CornerWeights mean{};
  for (const CornerWeights& vertex : part.vertices)
    for (std::size_t k = 0; k < 4; ++k) mean[k] += 0.25 * vertex[k];
  return mean;
}

std::vector<TetrahedronPart> cut_parts(const std::vector<TetrahedronPart>& parts,
                                       const std::array<double, 4>& corners) {
  std::vector<TetrahedronPart> left;
  for (const TetrahedronPart& part : parts) {
    std::array<double, 4> values{};
    for (std::size_t k = 0; k < 4; ++k) values[k] = linear_at(corners, part.vertices[k]);
    PartCut(part, values, left).append();
  }
  return left;
}

}  // namespace splatvol
