#include "sampler/integrals.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "format/splat_reader.h"
#include "sampler/cell_tetrahedra.h"
#include "sampler/tetrahedron_cut.h"

namespace splatvol {
namespace {

constexpr std::uint64_t most_held_bytes = std::uint64_t{128} << 20;  // of parts of the file

// A sum and what rounding took from it (Knuth's two-sum).
class Sum {
 public:
  void add(double number) {
    const double sum = sum_ + number, added = sum - sum_;
    rest_ += (sum_ - (sum - added)) + (number - added);
    sum_ = sum;
  }
  void add(const Sum& other) {
    add(other.sum_);
    add(other.rest_);
  }
  [[nodiscard]] double value() const { return sum_ + rest_; }

 private:
  double sum_ = 0, rest_ = 0;
};

struct Extreme {
  double value;
  dvec3 position{std::numeric_limits<double>::quiet_NaN()};
};

struct AttributeSums {
  Sum volume, missing, integral;
  Extreme low{std::numeric_limits<double>::infinity()};
  Extreme high{-std::numeric_limits<double>::infinity()};

  void add(const AttributeSums& other) {
    volume.add(other.volume);
    missing.add(other.missing);
    integral.add(other.integral);
    if (other.low.value < low.value) low = other.low;
    if (other.high.value > high.value) high = other.high;
  }
};

struct Sums {
  Sum volume, unknown;
  std::vector<AttributeSums> attributes;  // [attribute of the request]
};

// A range of values of an attribute that is read.
struct Limits {
  std::size_t attribute;  // index into Tetrahedra::values
  double low, high;

  [[nodiscard]] bool contain(double value) const { return low <= value && value <= high; }
};

// A request with the numbers of attributes.
struct Region {
  Box box;
  std::vector<HalfSpace> half_spaces;  // the largest component of each normal is 1 or -1
  std::vector<Limits> ranges;
};

// Returns the scaled distance of a position from a plane; 0 where rounding may have made it.
double distance_of(const HalfSpace& half_space, const dvec3& position) {
  const dvec3 products = half_space.normal * (position - half_space.point), sizes = glm::abs(products);
  const double distance = products.x + products.y + products.z;
  return std::abs(distance) > 4 * std::numeric_limits<double>::epsilon() * (sizes.x + sizes.y + sizes.z) ? distance : 0;
}

// Whether a part of a box may be in the region, if positions may be wrong by `rounding`.
bool meets(const Region& region, const Box& box, double rounding) {
  const Box wide{box.low - rounding, box.high + rounding};
  if (!glm::all(glm::lessThanEqual(wide.low, region.box.high)) ||
      !glm::all(glm::lessThanEqual(region.box.low, wide.high)))
    return false;
  return std::ranges::all_of(region.half_spaces, [&](const HalfSpace& half_space) {
    const dvec3 farthest = glm::mix(wide.low, wide.high, glm::greaterThan(half_space.normal, dvec3(0)));
    return distance_of(half_space, farthest) >= 0;
  });
}

double volume_of(const std::array<dvec3, 4>& corners) {
  const dvec3 a = corners[1] - corners[0], b = corners[2] - corners[0], c = corners[3] - corners[0];
  return std::abs(glm::dot(a, glm::cross(b, c))) / 6;
}

dvec3 position_at(const std::array<dvec3, 4>& corners, const CornerWeights& weights) {
  return corners[0] + weights[1] * (corners[1] - corners[0]) + weights[2] * (corners[2] - corners[0]) +
         weights[3] * (corners[3] - corners[0]);
}

double mean_of(const std::array<double, 4>& values, const CornerWeights& weights) {
  return (weights[0] * values[0] + weights[1] * values[1]) + (weights[2] * values[2] + weights[3] * values[3]);
}

// Integrates over a chunk.
class ChunkIntegration {
 public:
  // `attributes`: how many of those that are read are integrated: the first.
  ChunkIntegration(const Region& region, const Tetrahedra& tetrahedra, std::size_t attributes, Sums& sums)
      : region_(region), tetrahedra_(tetrahedra), sums_(sums) {
    sums_.attributes.resize(attributes);
  }

  void run() {
    find_cuts();
    pieces_.reserve(tetrahedra_.size());
    for (std::size_t t = 0; t < tetrahedra_.size(); ++t) add_tetrahedron(t);
    for (std::size_t a = 0; a < sums_.attributes.size(); ++a)
      for (const Piece& piece : pieces_) integrate(piece, a, sums_.attributes[a]);
  }

 private:
  // The part of a tetrahedron in the region.
  struct Piece {
    std::size_t tetrahedron;
    double volume;
    CornerWeights centroid;
    std::size_t first_vertex, vertices_end;  // in vertices_; none if it is whole
  };
  // A linear function, [point]: what it makes negative is cut off.
  using Cut = std::vector<double>;

  // Makes the functions that cut off something of the chunk. Those of ranges come last.
  void find_cuts() {
    for (int axis = 0; axis < 3; ++axis) {
      add_cut([&](std::size_t p) { return tetrahedra_.points[p][axis] - region_.box.low[axis]; });
      add_cut([&](std::size_t p) { return region_.box.high[axis] - tetrahedra_.points[p][axis]; });
    }
    for (const HalfSpace& half_space : region_.half_spaces)
      add_cut([&](std::size_t p) { return distance_of(half_space, tetrahedra_.points[p]); });
    first_range_ = cuts_.size();
    if (tetrahedra_.constant) return;
    for (const Limits& range : region_.ranges) {
      const std::vector<double>& values = tetrahedra_.values[range.attribute];
      add_cut([&](std::size_t p) { return values[p] - range.low; });
      add_cut([&](std::size_t p) { return range.high - values[p]; });
    }
  }

  template <class Function>
  void add_cut(const Function& function) {
    Cut cut(tetrahedra_.points.size());
    for (std::size_t p = 0; p < cut.size(); ++p) cut[p] = function(p);
    if (std::ranges::any_of(cut, [](double value) { return value < 0; })) cuts_.push_back(std::move(cut));
  }

  void add_tetrahedron(std::size_t t) {
    const double volume = volume_of(tetrahedra_.corners_of(t));
    if (!(volume > 0)) return;
    parts_.assign(1, whole_tetrahedron());
    if (!apply_cuts(t, 0, first_range_)) return;
    if (lacks_value_of_range(t)) return sums_.unknown.add(volume * share_of_parts());
    if (tetrahedra_.constant && !std::ranges::all_of(region_.ranges, [&](const Limits& range) {
          return range.contain(tetrahedra_.values[range.attribute][t]);
        }))
      return;
    if (apply_cuts(t, first_range_, cuts_.size())) add_piece(t, volume);
  }

  // Whether something is left.
  bool apply_cuts(std::size_t t, std::size_t first, std::size_t end) {
    const auto& [a, b, c, d] = tetrahedra_.corners[t];
    for (std::size_t i = first; i < end; ++i) {
      const Cut& cut = cuts_[i];
      const std::array values{cut[a], cut[b], cut[c], cut[d]};
      if (std::ranges::none_of(values, [](double value) { return value < 0; })) continue;
      if (std::ranges::none_of(values, [](double value) { return value > 0; })) return false;
      parts_ = cut_parts(parts_, values);
      if (parts_.empty()) return false;
    }
    return true;
  }

  [[nodiscard]] bool lacks_value_of_range(std::size_t t) const {
    return std::ranges::any_of(region_.ranges, [&](const Limits& range) {
      const auto [a, b, c, d] = tetrahedra_.values_of(t, range.attribute);
      return std::isnan(a + b + c + d);
    });
  }

  [[nodiscard]] double share_of_parts() const {
    double share = 0;
    for (const TetrahedronPart& part : parts_) share += part.share;
    return share;
  }

  void add_piece(std::size_t t, double volume) {
    const double share = share_of_parts();
    Piece piece{t, volume * share, {}, vertices_.size(), vertices_.size()};
    for (const TetrahedronPart& part : parts_) {
      const CornerWeights centroid = centroid_of(part);
      for (std::size_t k = 0; k < 4; ++k) piece.centroid[k] += part.share / share * centroid[k];
    }
    if (const bool is_whole = parts_.size() == 1 && parts_[0].share == 1; !is_whole)
      for (const TetrahedronPart& part : parts_)
        vertices_.insert(vertices_.end(), part.vertices.begin(), part.vertices.end());
    piece.vertices_end = vertices_.size();
    sums_.volume.add(piece.volume);
    pieces_.push_back(piece);
  }

  void integrate(const Piece& piece, std::size_t attribute, AttributeSums& sums) const {
    const std::array<double, 4> values = tetrahedra_.values_of(piece.tetrahedron, attribute);
    const double mean = tetrahedra_.constant ? values[0] : mean_of(values, piece.centroid);
    if (std::isnan(mean)) return sums.missing.add(piece.volume);
    sums.volume.add(piece.volume);
    sums.integral.add(piece.volume * mean);
    const auto [low, high] = std::minmax({values[0], values[1], values[2], values[3]});
    if (low < sums.low.value || high > sums.high.value) find_extremes(piece, attribute, values, sums);
  }

  // Looks at all vertices of a piece.
  void find_extremes(const Piece& piece, std::size_t attribute, const std::array<double, 4>& values,
                     AttributeSums& sums) const {
    const std::array<dvec3, 4> corners = tetrahedra_.corners_of(piece.tetrahedron);
    const auto look = [&](double value, const CornerWeights& weights) {
      if (value < sums.low.value) sums.low = {value, position_at(corners, weights)};
      if (value > sums.high.value) sums.high = {value, position_at(corners, weights)};
    };
    if (tetrahedra_.constant) return look(values[0], piece.centroid);
    if (piece.first_vertex == piece.vertices_end)
      for (std::size_t k = 0; k < 4; ++k) look(values[k], whole_tetrahedron().vertices[k]);
    for (std::size_t v = piece.first_vertex; v < piece.vertices_end; ++v)
      look(within_ranges(value_at(values, vertices_[v]), attribute), vertices_[v]);
  }

  // The value at which a range cuts is that of the range, and not one that rounding has moved out.
  [[nodiscard]] double within_ranges(double value, std::size_t attribute) const {
    for (const Limits& range : region_.ranges)
      if (range.attribute == attribute) value = std::clamp(value, range.low, range.high);
    return value;
  }

  const Region& region_;
  const Tetrahedra& tetrahedra_;
  Sums& sums_;
  std::vector<Cut> cuts_;
  std::size_t first_range_ = 0;
  std::vector<TetrahedronPart> parts_;  // of the tetrahedron that is cut
  std::vector<Piece> pieces_;
  std::vector<CornerWeights> vertices_;  // of pieces that are not whole
};

Status check_request(const IntegralRequest& request, const std::string& name) {
  if (request.box && !glm::all(glm::lessThanEqual(request.box->low, request.box->high)))
    return fail(ErrorCode::invalid_argument, "{}: the box is none: give the lower corner first", name);
  for (const HalfSpace& plane : request.clip_planes)
    for (int axis = 0; axis < 3; ++axis)
      if (!std::isfinite(plane.point[axis]) || !std::isfinite(plane.normal[axis]) || plane.normal == dvec3(0))
        return fail(ErrorCode::invalid_argument,
                    "{}: a clip plane has a finite point and a finite normal that is not 0, 0, 0", name);
  for (const ValueRange& range : request.ranges)
    if (!(range.low <= range.high))
      return fail(ErrorCode::invalid_argument, "{}: the range of \"{}\" is none: give the lower value first", name,
                  range.attribute);
  return {};
}

HalfSpace scaled(const HalfSpace& plane) {
  const dvec3 sizes = glm::abs(plane.normal);
  return {plane.point, plane.normal / std::max({sizes.x, sizes.y, sizes.z})};
}

// Makes the region, and adds attributes of its ranges to those that are read.
Result<Region> region_of(const format::VolumeInfo& info, const IntegralRequest& request, const std::string& name,
                         std::vector<std::size_t>& attributes) {
  SPLATVOL_TRY(check_request(request, name));
  Region region{request.box.value_or(format::SplatSelection().box), {}, {}};
  for (const HalfSpace& plane : request.clip_planes) region.half_spaces.push_back(scaled(plane));
  for (const ValueRange& range : request.ranges) {
    SPLATVOL_TRY_ASSIGN(number, format::find_attribute(info, range.attribute, name));
    const auto attribute = static_cast<std::size_t>(number);
    const auto found = std::ranges::find(attributes, attribute);
    region.ranges.push_back({static_cast<std::size_t>(found - attributes.begin()), range.low, range.high});
    if (found == attributes.end()) attributes.push_back(attribute);
  }
  return region;
}

// The ranges by which chunks are left out: the first two whose attributes are missing nowhere. Where they are, volume
// without a value is counted.
class VisibleChunks {
 public:
  VisibleChunks(const format::VolumeInfo& info, const Region& region, const std::vector<std::size_t>& attributes)
      : info_(info) {
    for (const Limits& range : region.ranges)
      if (info.attributes[attributes[range.attribute]].missing == 0 && ranges_.size() < 2)
        ranges_.push_back({attributes[range.attribute], range.low, range.high});
  }

  [[nodiscard]] format::SummaryAttributes summaries() const {
    format::SummaryAttributes summaries;
    if (!ranges_.empty()) summaries.values = static_cast<int>(ranges_[0].attribute);
    if (ranges_.size() > 1) summaries.opacity = static_cast<int>(ranges_[1].attribute);
    return summaries;
  }

  [[nodiscard]] bool operator()(const format::CellPage& page, std::size_t chunk) const {
    return (ranges_.empty() || meets(ranges_[0], page.summaries[chunk])) &&
           (ranges_.size() < 2 || meets(ranges_[1], page.opacity_summaries[chunk]));
  }

 private:
  [[nodiscard]] bool meets(const Limits& range, const format::ValueSummary& summary) const {
    const format::Attribute& attribute = info_.attributes[range.attribute];
    return attribute.value(double{summary.min}) <= range.high && attribute.value(double{summary.max}) >= range.low;
  }

  const format::VolumeInfo& info_;
  std::vector<Limits> ranges_;  // with indices into VolumeInfo::attributes
};

Integral integral_of(const AttributeSums& sums, std::string name, const std::string& unit) {
  Integral integral{.name = std::move(name),
                    .unit = unit,
                    .volume = sums.volume.value(),
                    .missing_volume = sums.missing.value(),
                    .integral = sums.integral.value()};
  if (!(integral.volume > 0)) return integral;
  integral.mean = integral.integral / integral.volume;
  integral.low = sums.low.value;
  integral.high = sums.high.value;
  integral.low_position = sums.low.position;
  integral.high_position = sums.high.position;
  return integral;
}

}  // namespace

Result<Integrals> integrate_cells(const format::Volume& volume, const IntegralRequest& request, std::uint64_t memory,
                                  std::size_t threads, const std::function<void(double)>& progress) {
  const format::VolumeInfo& info = volume.info();
  SPLATVOL_TRY_ASSIGN(selection, format::select_splats(volume, {}, request.attributes, format::SplatSelection().box));
  std::vector<std::size_t> attributes = selection.attributes;
  SPLATVOL_TRY_ASSIGN(region, region_of(info, request, volume.name(), attributes));
  const VisibleChunks is_visible(info, region, attributes);
  SPLATVOL_TRY_ASSIGN(cells, CellTetrahedra::open(volume, attributes, own_room(std::min(memory, most_held_bytes)),
                                                  is_visible.summaries()));
  if (!cells) return fail_without_cells(volume);
  SPLATVOL_TRY_ASSIGN(chunks,
                      cells->chunks([&](const Box& box) { return meets(region, box, cells->rounding()); }, is_visible));

  Sums all{{}, {}, std::vector<AttributeSums>(selection.attributes.size())};
  SPLATVOL_TRY(cells->for_each<Sums>(
      chunks,
      [&](const format::CellChunkEntry&, const Tetrahedra& tetrahedra, Sums& sums) -> Status {
        ChunkIntegration(region, tetrahedra, selection.attributes.size(), sums).run();
        return {};
      },
      [&](const format::CellChunkEntry& entry, const Sums& sums) -> Status {
        all.volume.add(sums.volume);
        all.unknown.add(sums.unknown);
        for (std::size_t a = 0; a < all.attributes.size(); ++a) all.attributes[a].add(sums.attributes[a]);
        progress(static_cast<double>(&entry - chunks.data() + 1) / static_cast<double>(chunks.size()));
        return {};
      },
      threads));

  Integrals integrals{all.volume.value(), all.unknown.value(), {}, cells->unknown_cells()};
  for (std::size_t a = 0; a < all.attributes.size(); ++a)
    integrals.attributes.push_back(
        integral_of(all.attributes[a], selection.names[a], info.attributes[selection.attributes[a]].unit));
  return integrals;
}

}  // namespace splatvol
