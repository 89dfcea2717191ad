#include "sampler/cell_line.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <limits>
#include <string>
#include <thread>
#include <utility>

#include "base/interruption.h"
#include "base/run_tasks.h"
#include "sampler/tetrahedron.h"

namespace splatvol {
namespace {

constexpr double none = std::numeric_limits<double>::quiet_NaN();
constexpr std::size_t no_number = std::numeric_limits<std::size_t>::max();

// A part of the line, as shares of its length.
struct Range {
  double begin = 0, end = 1;

  [[nodiscard]] bool is_empty() const { return !(begin <= end); }

  // Leaves the part where a function that is linear along the line, and has these values at its ends, is not negative.
  void cut(double at_start, double at_end) {
    if (at_start < 0 && at_end < 0) begin = 1, end = 0;
    if (at_start < 0 && at_end >= 0) begin = std::max(begin, at_start / (at_start - at_end));
    if (at_start >= 0 && at_end < 0) end = std::min(end, at_start / (at_start - at_end));
  }
};

struct Line {
  dvec3 start, end;

  [[nodiscard]] double length() const { return glm::length(end - start); }
  [[nodiscard]] dvec3 at(double share) const { return share == 1 ? end : start + share * (end - start); }

  // The part that is in a box, or so near.
  [[nodiscard]] Range in(const Box& box, double reach) const {
    Range range;
    for (int axis = 0; axis < 3; ++axis) {
      range.cut(start[axis] - box.low[axis] + reach, end[axis] - box.low[axis] + reach);
      range.cut(box.high[axis] - start[axis] + reach, box.high[axis] - end[axis] + reach);
    }
    return range;
  }
};

// A tetrahedron on the line, or near it.
struct Crossed {
  TetrahedronCorners corners;
  double reach = 0;
  Range near;                                      // within reach
  Range inside = {};                               // empty, or a position, if the line only comes near
  std::uint64_t cell = 0;                          // of cells with values of their own: rows are between these
  std::vector<std::array<double, 4>> values = {};  // [attribute][corner]
  CornerWeights at_begin{}, at_end{};              // of `inside`

  [[nodiscard]] bool is_crossed() const { return inside.begin < inside.end; }
  [[nodiscard]] bool has_values() const {
    return std::ranges::any_of(values, [](const auto& v) { return !std::isnan(v[0] + v[1] + v[2] + v[3]); });
  }

  // Linear between the ends of `inside`.
  [[nodiscard]] CornerWeights weights_at(double share) const {
    const double way = std::clamp((share - inside.begin) / (inside.end - inside.begin), 0.0, 1.0);
    CornerWeights weights{};
    for (std::size_t k = 0; k < 4; ++k) weights[k] = (1 - way) * at_begin[k] + way * at_end[k];
    return weights;
  }
};

// A face of a tetrahedron on the line: distances from its plane at the line's ends, positive inside. Those of the two
// tetrahedra of a face differ in their signs only.
struct Face {
  std::array<std::size_t, 3> corners;
  double at_start = 0, at_end = 0;
};

std::array<Face, 4> faces_of(const TetrahedronCorners& corners, const Line& line) {
  std::array<Face, 4> faces = {{{{1, 2, 3}}, {{0, 2, 3}}, {{0, 1, 3}}, {{0, 1, 2}}}};
  for (std::size_t k = 0; k < 4; ++k) {
    const dvec3& a = corners[faces[k].corners[0]];
    dvec3 normal = glm::cross(corners[faces[k].corners[1]] - a, corners[faces[k].corners[2]] - a);
    const double length = glm::length(normal), side = glm::dot(normal, corners[k] - a);
    normal *= length > 0 && side != 0 ? std::copysign(1 / length, side) : 0;
    faces[k].at_start = glm::dot(normal, line.start - a);
    faces[k].at_end = glm::dot(normal, line.end - a);
  }
  return faces;
}

bool is_flat(const TetrahedronCorners& corners) {
  const auto& [a, b, c, d] = corners;
  return !(std::abs(glm::dot(b - a, glm::cross(c - a, d - a))) > 0);
}

// The weights where the line enters or leaves through a face, or at an end of the line.
CornerWeights weights_on(const TetrahedronCorners& corners, const Face* face, const dvec3& position) {
  if (!face) {
    if (const auto weights = weights_in(corners, position)) return *weights;
    return nearest_on(corners, position, std::numeric_limits<double>::infinity())->weights;
  }
  CornerWeights weights{};
  const auto& [a, b, c] = face->corners;
  const std::array<double, 3> of_face = nearest_on({corners[a], corners[b], corners[c]}, position);
  for (std::size_t k = 0; k < 3; ++k) weights[face->corners[k]] = of_face[k];
  return weights;
}

// Cuts `near` and sets `inside`. Returns false if the line does not come near.
bool cross(const Line& line, double rounding, Crossed& crossed) {
  const std::array<Face, 4> faces = faces_of(crossed.corners, line);
  const Face *entered = nullptr, *left = nullptr;
  if (is_flat(crossed.corners)) crossed.inside = {1, 0};
  for (const Face& face : faces) {
    crossed.near.cut(face.at_start + crossed.reach, face.at_end + crossed.reach);
    if (std::max(std::abs(face.at_start), std::abs(face.at_end)) <= rounding) continue;  // the line is on the face
    const Range before = crossed.inside;
    crossed.inside.cut(face.at_start, face.at_end);
    if (crossed.inside.begin > before.begin) entered = &face;
    if (crossed.inside.end < before.end) left = &face;
  }
  if (crossed.near.is_empty()) return false;
  if (!crossed.is_crossed()) return true;
  crossed.at_begin = weights_on(crossed.corners, entered, line.at(crossed.inside.begin));
  crossed.at_end = weights_on(crossed.corners, left, line.at(crossed.inside.end));
  return true;
}

// Sorted shares; those that rounding alone keeps apart are one.
class Stops {
 public:
  // `shares`: 0 and 1 are among them.
  Stops(std::vector<double> shares, double rounding) : rounding_(rounding) {
    std::ranges::sort(shares);
    for (const double share : shares)
      if (stops_.empty() || (share - stops_.back() > rounding && 1 - share > rounding)) stops_.push_back(share);
    stops_.push_back(1);
  }

  [[nodiscard]] std::size_t intervals() const { return stops_.size() - 1; }
  [[nodiscard]] double at(std::size_t stop) const { return stops_[stop]; }
  [[nodiscard]] double middle_of(std::size_t interval) const { return 0.5 * (stops_[interval] + stops_[interval + 1]); }

  // The number of the stop that a share became.
  [[nodiscard]] std::size_t stop_of(double share) const {
    if (1 - share <= rounding_) return intervals();
    return static_cast<std::size_t>(std::ranges::upper_bound(stops_, share) - stops_.begin()) - 1;
  }

 private:
  double rounding_;
  std::vector<double> stops_;
};

// Which tetrahedron an interval between stops belongs to.
struct Owner {
  std::size_t number = no_number;
  bool is_inside = false;  // else the tetrahedron is the nearest one within reach

  [[nodiscard]] bool operator==(const Owner&) const = default;
};

std::vector<Owner> find_owners(const Line& line, const std::vector<Crossed>& all, const Stops& stops) {
  std::vector<Owner> owners(stops.intervals());
  for (std::size_t number = 0; number < all.size(); ++number) {
    const Crossed& crossed = all[number];
    if (!crossed.is_crossed() || !crossed.has_values()) continue;
    const std::size_t end = stops.stop_of(crossed.inside.end);
    for (std::size_t i = stops.stop_of(crossed.inside.begin); i < end; ++i)
      if (!owners[i].is_inside) owners[i] = {number, true};
  }
  // What rounding has left between tetrahedra.
  std::vector<double> distances(owners.size(), std::numeric_limits<double>::infinity());
  for (std::size_t number = 0; number < all.size(); ++number) {
    const Crossed& crossed = all[number];
    if (!crossed.has_values()) continue;
    const std::size_t end = std::min(stops.stop_of(crossed.near.end) + 1, owners.size());
    for (std::size_t i = stops.stop_of(crossed.near.begin); i < end; ++i) {
      if (owners[i].is_inside) continue;
      const auto point = nearest_on(crossed.corners, line.at(stops.middle_of(i)), crossed.reach);
      if (!point || !(point->distance < distances[i])) continue;
      distances[i] = point->distance;
      owners[i] = {number, false};
    }
  }
  return owners;
}

// Adds rows piece by piece.
class Rows {
 public:
  Rows(const Line& line, std::vector<double> tolerances)
      : line_(line), length_(line.length()), tolerances_(std::move(tolerances)) {
    rows_.values.resize(tolerances_.size());
  }

  void add_piece(double begin, double end, const std::vector<double>& at_begin, const std::vector<double>& at_end) {
    if (rows_.arc_lengths.empty() || !are_last(at_begin)) add(begin, at_begin);
    add(end, at_end);
  }

  [[nodiscard]] LineRows rows() && { return std::move(rows_); }

 private:
  // Whether the last row has these values, up to rounding.
  [[nodiscard]] bool are_last(const std::vector<double>& values) const {
    for (std::size_t a = 0; a < values.size(); ++a) {
      const double last = rows_.values[a].back();
      if (std::isnan(last) != std::isnan(values[a]) || std::abs(last - values[a]) > tolerances_[a]) return false;
    }
    return true;
  }

  void add(double share, const std::vector<double>& values) {
    rows_.arc_lengths.push_back(share * length_);
    rows_.positions.push_back(line_.at(share));
    for (std::size_t a = 0; a < values.size(); ++a) rows_.values[a].push_back(values[a]);
  }

  Line line_;
  double length_;
  std::vector<double> tolerances_;  // [attribute]
  LineRows rows_;
};

std::vector<double> values_at(const Crossed& crossed, bool is_inside, double share, const dvec3& position) {
  constexpr double anywhere = std::numeric_limits<double>::infinity();
  const CornerWeights weights =
      is_inside ? crossed.weights_at(share) : nearest_on(crossed.corners, position, anywhere)->weights;
  std::vector<double> values;
  for (const auto& of_corners : crossed.values) values.push_back(value_at(of_corners, weights));
  return values;
}

// `rounding`: of positions on the line.
Result<std::vector<Crossed>> find_crossed(const CellTetrahedra& cells, const Line& line, double rounding,
                                          const ReadTetrahedra& read) {
  const auto meets = [&](const Box& box) { return !line.in(box, cells.reach() + rounding).is_empty(); };
  SPLATVOL_TRY_ASSIGN(chunks, cells.chunks(meets));
  std::vector<Crossed> all;
  using Part = std::vector<Crossed>;
  const auto work = [&](const format::CellChunkEntry& entry, const Tetrahedra& tetrahedra, Part& part) -> Status {
    const std::uint64_t first = static_cast<std::uint64_t>(&entry - chunks.data()) << 32;
    for (std::size_t t = 0; t < tetrahedra.size(); ++t) {
      const TetrahedronCorners corners = tetrahedra.corners_of(t);
      Box box;
      for (const dvec3& corner : corners) box.include(corner);
      const double reach = cells.reach(box) + rounding;
      Crossed crossed{corners, reach, line.in(box, reach)};
      if (crossed.near.is_empty() || !cross(line, rounding, crossed)) continue;
      crossed.cell = first + (tetrahedra.constant ? tetrahedra.cells[t] : t);
      for (std::size_t a = 0; a < cells.attributes().size(); ++a) crossed.values.push_back(tetrahedra.values_of(t, a));
      part.push_back(std::move(crossed));
    }
    return {};
  };
  const auto take = [&](const format::CellChunkEntry& /*entry*/, Part& part) -> Status {
    std::ranges::move(part, std::back_inserter(all));
    return {};
  };
  if (!read) {
    SPLATVOL_TRY(cells.for_each<Part>(chunks, work, take));
    return all;
  }
  std::vector<Part> parts(chunks.size());
  const auto run = [&](std::size_t i, std::size_t /*thread*/) -> Status {
    Tetrahedra scratch;
    SPLATVOL_TRY(check_interruption());
    SPLATVOL_TRY_ASSIGN(tetrahedra, read(chunks[i], scratch));
    return work(chunks[i], *tetrahedra, parts[i]);
  };
  SPLATVOL_TRY(run_tasks(chunks.size(), std::max(1u, std::thread::hardware_concurrency()), run));
  for (std::size_t i = 0; i < chunks.size(); ++i) SPLATVOL_TRY(take(chunks[i], parts[i]));
  return all;
}

}  // namespace

Result<LineRows> follow_line(const CellTetrahedra& cells, const dvec3& start, const dvec3& end,
                             const ReadTetrahedra& read) {
  const Line line{start, end};
  const std::string& name = cells.reader().volume().name();
  if (!(line.length() > 0 && std::isfinite(line.length())))
    return fail(ErrorCode::invalid_argument, "{}: the line has no length, or none that is finite", name);
  if (cells.unknown_cells() > 0)
    return fail(ErrorCode::unsupported, "{}: {} of its cells have shapes that this version does not know", name,
                cells.unknown_cells());
  const double rounding = std::max({cells.rounding(), rounding_of(start), rounding_of(end)});
  if (rounding > cells.rounding() && rounding > 1e-6 * cells.reader().volume().info().cube.edge)
    return fail(ErrorCode::invalid_argument, "{}: the line is too long to tell where it meets cells", name);
  SPLATVOL_TRY_ASSIGN(all, find_crossed(cells, line, rounding, read));
  std::vector<double> shares = {0, 1};
  for (const Crossed& crossed : all) {
    const Range& range = crossed.is_crossed() ? crossed.inside : crossed.near;
    shares.insert(shares.end(), {range.begin, range.end});
  }
  const Stops stops(std::move(shares), rounding / line.length());
  const std::vector<Owner> owners = find_owners(line, all, stops);

  std::vector<double> tolerances;
  for (const std::size_t a : cells.attributes()) {
    const format::Attribute& attribute = cells.reader().volume().info().attributes[a];
    tolerances.push_back(1e-9 * (attribute.max - attribute.min));
  }
  Rows rows(line, std::move(tolerances));
  const std::vector<double> nothing(cells.attributes().size(), none);
  const auto are_one = [&](const Owner& a, const Owner& b) {
    return a == b || (a.is_inside && b.is_inside && all[a.number].cell == all[b.number].cell);
  };
  for (std::size_t i = 0, next = 0; i < owners.size(); i = next) {
    for (next = i + 1; next < owners.size() && are_one(owners[i], owners[next]);) ++next;
    const double from = stops.at(i), to = stops.at(next);
    const auto [number, is_inside] = owners[i];
    if (number == no_number) {
      rows.add_piece(from, to, nothing, nothing);
      continue;
    }
    rows.add_piece(from, to, values_at(all[number], is_inside, from, line.at(from)),
                   values_at(all[number], is_inside, to, line.at(to)));
  }
  return std::move(rows).rows();
}

double value_on_line(const LineRows& rows, std::size_t attribute, double arc_length) {
  const std::vector<double>& values = rows.values[attribute];
  const auto at = std::min(std::ranges::lower_bound(rows.arc_lengths, arc_length), rows.arc_lengths.end() - 1);
  const auto row = static_cast<std::size_t>(at - rows.arc_lengths.begin());
  if (*at > arc_length && row > 0) {
    const double way = (arc_length - *(at - 1)) / (*at - *(at - 1));
    return (1 - way) * values[row - 1] + way * values[row];
  }
  const bool jumps = row + 1 < values.size() && at[1] == *at;
  return std::isnan(values[row]) && jumps ? values[row + 1] : values[row];
}

LineRows in_equal_steps(const LineRows& rows, const dvec3& start, const dvec3& end, std::size_t positions) {
  const Line line{start, end};
  LineRows samples;
  samples.values.resize(rows.values.size());
  for (std::size_t k = 0; k < positions; ++k) {
    const double share = static_cast<double>(k) / static_cast<double>(positions - 1);
    samples.arc_lengths.push_back(share * line.length());
    samples.positions.push_back(line.at(share));
    for (std::size_t a = 0; a < rows.values.size(); ++a)
      samples.values[a].push_back(value_on_line(rows, a, samples.arc_lengths.back()));
  }
  return samples;
}

}  // namespace splatvol
