#include "sampler/integrals.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "format/splat_reader.h"
#include "sampler/cell_tetrahedra.h"
#include "sampler/integral_region.h"
#include "sampler/tetrahedron_cut.h"

namespace splatvol {
namespace {

constexpr std::uint64_t most_held_bytes = std::uint64_t{128} << 20;  // of parts of the file

struct Sums {
  CompensatedSum volume, unknown;
  std::vector<ValueSums> attributes;  // [attribute of the request]
};

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
  ChunkIntegration(const IntegralRegion& region, const Tetrahedra& tetrahedra, std::size_t attributes, Sums& sums)
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
    for (const ValueLimits& range : region_.ranges) {
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
    if (tetrahedra_.constant && !std::ranges::all_of(region_.ranges, [&](const ValueLimits& range) {
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
    return std::ranges::any_of(region_.ranges, [&](const ValueLimits& range) {
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

  void integrate(const Piece& piece, std::size_t attribute, ValueSums& sums) const {
    const std::array<double, 4> values = tetrahedra_.values_of(piece.tetrahedron, attribute);
    const double mean = tetrahedra_.constant ? values[0] : mean_of(values, piece.centroid);
    if (std::isnan(mean)) return sums.missing.add(piece.volume);
    sums.size.add(piece.volume);
    sums.integral.add(piece.volume * mean);
    const auto [low, high] = std::minmax({values[0], values[1], values[2], values[3]});
    if (low < sums.low.value || high > sums.high.value) find_extremes(piece, attribute, values, sums);
  }

  // Looks at all vertices of a piece.
  void find_extremes(const Piece& piece, std::size_t attribute, const std::array<double, 4>& values,
                     ValueSums& sums) const {
    const std::array<dvec3, 4> corners = tetrahedra_.corners_of(piece.tetrahedron);
    const auto look = [&](double value, const CornerWeights& weights) {
      sums.look_at(value, position_at(corners, weights));
    };
    if (tetrahedra_.constant) return look(values[0], piece.centroid);
    if (piece.first_vertex == piece.vertices_end)
      for (std::size_t k = 0; k < 4; ++k) look(values[k], whole_tetrahedron().vertices[k]);
    for (std::size_t v = piece.first_vertex; v < piece.vertices_end; ++v)
      look(within_ranges(value_at(values, vertices_[v]), attribute), vertices_[v]);
  }

  // The value at which a range cuts is that of the range, and not one that rounding has moved out.
  [[nodiscard]] double within_ranges(double value, std::size_t attribute) const {
    for (const ValueLimits& range : region_.ranges)
      if (range.attribute == attribute) value = std::clamp(value, range.low, range.high);
    return value;
  }

  const IntegralRegion& region_;
  const Tetrahedra& tetrahedra_;
  Sums& sums_;
  std::vector<Cut> cuts_;
  std::size_t first_range_ = 0;
  std::vector<TetrahedronPart> parts_;  // of the tetrahedron that is cut
  std::vector<Piece> pieces_;
  std::vector<CornerWeights> vertices_;  // of pieces that are not whole
};

Integral integral_of(const ValueSums& sums, std::string name, const std::string& unit) {
  return {sums.result(std::move(name), unit), sums.size.value(), sums.missing.value()};
}

}  // namespace

Result<Integrals> integrate_cells(const format::Volume& volume, const IntegralRequest& request, std::uint64_t memory,
                                  std::size_t threads, const std::function<void(double)>& progress) {
  const format::VolumeInfo& info = volume.info();
  SPLATVOL_TRY_ASSIGN(selection, format::select_splats(volume, {}, request.attributes, format::SplatSelection().box));
  std::vector<std::size_t> attributes = selection.attributes;
  SPLATVOL_TRY_ASSIGN(region, region_of(info, request, volume.name(), attributes));
  const VisibleChunks is_visible(info, region.ranges, attributes);
  SPLATVOL_TRY_ASSIGN(cells, CellTetrahedra::open(volume, attributes, own_room(std::min(memory, most_held_bytes)),
                                                  is_visible.summaries()));
  if (!cells) return fail_without_cells(volume);
  SPLATVOL_TRY_ASSIGN(chunks,
                      cells->chunks([&](const Box& box) { return region.meets(box, cells->rounding()); }, is_visible));

  Sums all{{}, {}, std::vector<ValueSums>(selection.attributes.size())};
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
