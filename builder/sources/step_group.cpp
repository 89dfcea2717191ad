#include "builder/sources/step_group.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <iterator>
#include <utility>

#include "builder/sources/array_attributes.h"

namespace splatvol {
namespace {

template <class T>
bool same_bytes(const std::vector<T>& a, const std::vector<T>& b) {
  return a.size() == b.size() && (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0);
}

// Says in which way the mesh of a piece differs from that of the first step; empty: in none.
std::string difference(const Piece& first, const Piece& other) {
  if (other.points.size() != first.points.size())
    return fmt::format("it has {} points instead of {}", other.points.size(), first.points.size());
  if (!same_bytes(first.points, other.points)) return "its points are at other positions";
  if (!same_bytes(first.tetrahedra, other.tetrahedra)) return "its cells are others";
  if (first.material.has_value() != other.material.has_value()) return "its cells are others";
  if (first.cells.has_value() != other.cells.has_value()) return "its cells are others";
  if (first.cells && (!same_bytes(first.cells->corners, other.cells->corners) ||
                      !same_bytes(first.cells->tetrahedra, other.cells->tetrahedra)))
    return "its cells are others";
  if (first.material && !same_bytes(first.material->moments, other.material->moments)) return "its voxels are others";
  return {};
}

// One piece repeats no vertex, so its points of one position are those of a crack or of a field that jumps.
VertexCopies copies_of(const Source& source, bool blocks_apart) {
  if (source.piece_count() < 2 || source.averages_by_piece()) return VertexCopies::none;
  return blocks_apart ? VertexCopies::same_block : VertexCopies::same_place;
}

template <class T>
void append(std::vector<T>& all, std::vector<T>& more) {
  std::ranges::move(more, std::back_inserter(all));
}

/// Returns the values of attributes in another order. An empty list stays empty.
template <class T>
std::vector<T> in_order(std::vector<T> values, const std::vector<std::size_t>& order) {
  if (values.empty()) return values;
  std::vector<T> ordered;
  for (const std::size_t attribute : order) ordered.push_back(std::move(values[attribute]));
  return ordered;
}

void put_in_order(Piece& piece, const std::vector<std::size_t>& order) {
  if (std::ranges::is_sorted(order)) return;
  piece.values = in_order(std::move(piece.values), order);
  piece.fills = in_order(std::move(piece.fills), order);
  if (!piece.material) return;
  piece.material->value_moments = in_order(std::move(piece.material->value_moments), order);
  piece.material->gradients = in_order(std::move(piece.material->gradients), order);
}

}  // namespace

StepGroup::StepGroup(std::vector<SeriesStep> steps, std::unique_ptr<Source> first, bool blocks_apart,
                     std::vector<std::string> attributes, const std::vector<std::size_t>& order)
    : steps_(std::move(steps)),
      first_(std::move(first)),
      others_(steps_.size()),
      finished_(steps_.size()),
      step_attributes_(std::move(attributes)),
      orders_(steps_.size(), order),
      units_(in_order(first_->units(), order)),
      components_(in_order(first_->components(), order)),
      copies_(copies_of(*first_, blocks_apart)),
      blocks_(steps_.size()),
      first_blocks_(steps_.size()),
      stated_times_(steps_.size()) {
  for (std::size_t step = 0; step < steps_.size(); ++step)
    attributes_.insert(attributes_.end(), step_attributes_.begin(), step_attributes_.end());
  stated_times_[0] = first_->stated_time();
}

Result<std::unique_ptr<StepGroup>> StepGroup::open(std::vector<SeriesStep> steps, bool blocks_apart,
                                                   std::vector<std::string> attributes) {
  SPLATVOL_TRY_ASSIGN(first, steps.front().open());
  if (attributes.empty()) attributes = first->attributes();
  SPLATVOL_TRY_ASSIGN(order, match_attributes(steps.front().name, first->attributes(), "the steps before", attributes));
  return std::unique_ptr<StepGroup>(
      new StepGroup(std::move(steps), std::move(first), blocks_apart, std::move(attributes), order));
}

std::vector<std::string> StepGroup::units() const {
  std::vector<std::string> units;
  for (std::size_t step = 0; step < steps_.size(); ++step) units.insert(units.end(), units_.begin(), units_.end());
  return units;
}

std::vector<int> StepGroup::components() const {
  std::vector<int> components;
  for (std::size_t step = 0; step < steps_.size(); ++step)
    components.insert(components.end(), components_.begin(), components_.end());
  return components;
}

std::vector<std::string> StepGroup::conversions() const {
  std::vector<std::string> all = first_->conversions();
  all.insert(all.end(), conversions_.begin(), conversions_.end());
  return all;
}

Result<std::unique_ptr<Piece>> StepGroup::next() {
  SPLATVOL_TRY_ASSIGN(piece, first_->next());
  if (piece) put_in_order(*piece, orders_[0]);
  for (std::size_t step = 1; step < steps_.size(); ++step) {
    if (!others_[step] && !finished_[step]) SPLATVOL_TRY(open_other(step));
    std::unique_ptr<Piece> other;
    if (!finished_[step]) {
      SPLATVOL_TRY_ASSIGN(next, others_[step]->next());
      other = std::move(next);
    }
    if ((piece == nullptr) != (other == nullptr))
      return fail(ErrorCode::invalid_data, "{}: it has {} pieces than {}: {}", steps_[step].name,
                  piece ? "fewer" : "more", steps_[0].name, series_of_files_hint);
    if (!piece) continue;
    put_in_order(*other, orders_[step]);
    SPLATVOL_TRY(add(step, std::move(other), *piece));
    note_conversions(step);
    SPLATVOL_TRY(close_finished(step));
  }
  return piece;
}

Status StepGroup::open_other(std::size_t step) {
  const std::string& name = steps_[step].name;
  SPLATVOL_TRY_ASSIGN(source, steps_[step].open());
  SPLATVOL_TRY_SET(orders_[step], match_attributes(name, source->attributes(), steps_[0].name, step_attributes_));
  SPLATVOL_TRY(check_components(name, step_attributes_, in_order(source->components(), orders_[step]), steps_[0].name,
                                components_));
  if ((first_->single_precision() && !source->single_precision()) ||
      source->brings_material() != first_->brings_material())
    return fail(ErrorCode::invalid_data, "{}: its numbers are of another kind than those of {}", name, steps_[0].name);
  stated_times_[step] = source->stated_time();
  const std::vector<std::string> units = in_order(source->units(), orders_[step]);
  for (std::size_t a = 0; a < units_.size(); ++a)
    if (units_[a].empty()) units_[a] = units[a];
  others_[step] = std::move(source);
  return {};
}

// Names the conversions of a step that the first step does not need. One is a mean over cells, where the first step has
// values of points.
void StepGroup::note_conversions(std::size_t step) {
  const std::vector<std::string> of_first = first_->conversions();
  for (const std::string& line : others_[step]->conversions()) {
    const auto same = [&](const std::string& known) { return known.ends_with(line); };
    if (std::ranges::none_of(of_first, same) && std::ranges::none_of(conversions_, same))
      conversions_.push_back(fmt::format("{}: {}", steps_[step].name, line));
  }
}

// Whether the pieces of a step are in the blocks of the first step. Blocks may have other names there.
bool StepGroup::has_same_block(std::size_t step, std::uint64_t first, std::uint64_t other) {
  return copies_ != VertexCopies::same_block || (blocks_[step].try_emplace(first, other).first->second == other &&
                                                 first_blocks_[step].try_emplace(other, first).first->second == first);
}

Status StepGroup::add(std::size_t step, std::unique_ptr<Piece> other, Piece& piece) {
  std::string different = difference(piece, *other);
  if (different.empty() && !has_same_block(step, piece.block, other->block)) different = "its blocks are others";
  if (!different.empty())
    return fail(ErrorCode::invalid_data, "{}: its mesh is not that of {}: {}; {}", steps_[step].name, steps_[0].name,
                different, series_of_files_hint);
  append(piece.values, other->values);
  append(piece.fills, other->fills);
  piece.census.unwritten += other->census.unwritten;
  piece.census.open_ends += other->census.open_ends;
  piece.census.losses.merge(other->census.losses);
  if (!piece.material) return {};
  append(piece.material->value_moments, other->material->value_moments);
  append(piece.material->gradients, other->material->gradients);
  return {};
}

// A source of a single piece is closed at once: it may hold a whole mesh.
Status StepGroup::close_finished(std::size_t step) {
  if (others_[step]->piece_count() != 1) return {};
  SPLATVOL_TRY_ASSIGN(next, others_[step]->next());
  if (next)
    return fail(ErrorCode::invalid_data, "{}: it has more pieces than {}: {}", steps_[step].name, steps_[0].name,
                series_of_files_hint);
  others_[step].reset();
  finished_[step] = true;
  return {};
}

}  // namespace splatvol
