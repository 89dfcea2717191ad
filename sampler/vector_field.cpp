#include "sampler/vector_field.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "format/part_kinds.h"

namespace splatvol {
namespace {

constexpr std::size_t dimensions = 3;

std::string component_of(const std::string& vector, std::size_t axis) { return fmt::format("{}[{}]", vector, axis); }

bool is_vector(const format::VolumeInfo& info, const std::string& name) {
  for (std::size_t axis = 0; axis < dimensions; ++axis)
    if (info.find_attribute(component_of(name, axis)) < 0) return false;
  return info.find_attribute(component_of(name, dimensions)) < 0;
}

Result<std::vector<std::size_t>> find_attributes(const format::Volume& volume, const std::string& vector,
                                                 const std::vector<std::string>& others) {
  const format::VolumeInfo& info = volume.info();
  if (!is_vector(info, vector))
    return fail(ErrorCode::invalid_argument,
                "{}: \"{}\" is no vector, which has three components \"{}[0]\" to \"{}[2]\"; vectors: {}",
                volume.name(), vector, vector, vector, fmt::join(vectors_of(info), ", "));
  std::vector<std::size_t> attributes;
  const auto add = [&](const std::string& name) -> Status {
    SPLATVOL_TRY_ASSIGN(number, format::find_attribute(info, name, volume.name()));
    attributes.push_back(static_cast<std::size_t>(number));
    return {};
  };
  for (std::size_t axis = 0; axis < dimensions; ++axis) SPLATVOL_TRY(add(component_of(vector, axis)));
  for (const std::string& name : others) SPLATVOL_TRY(add(name));
  return attributes;
}

std::vector<Box> boxes_of(const std::vector<format::CellChunkEntry>& chunks) {
  std::vector<Box> boxes;
  boxes.reserve(chunks.size());
  for (const format::CellChunkEntry& chunk : chunks) boxes.push_back(box_of_cells(chunk));
  return boxes;
}

Box box_of(const Tetrahedra& cells, std::uint32_t tetrahedron) {
  Box box;
  for (const std::uint32_t corner : cells.corners[tetrahedron]) box.include(cells.points[corner]);
  return box;
}

BoxTree tree_of(const Tetrahedra& cells) {
  std::vector<Box> boxes;
  boxes.reserve(cells.size());
  for (std::uint32_t t = 0; t < cells.size(); ++t) boxes.push_back(box_of(cells, t));
  return BoxTree(boxes);
}

bool has_vector(const Tetrahedra& cells, std::uint32_t tetrahedron) {
  double sum = 0;
  for (std::size_t axis = 0; axis < dimensions; ++axis)
    for (const double value : cells.values_of(tetrahedron, axis)) sum += value;
  return !std::isnan(sum);
}

Box around(const dvec3& position, double reach) { return {position - reach, position + reach}; }

}  // namespace

std::vector<std::string> vectors_of(const format::VolumeInfo& info) {
  std::vector<std::string> vectors;
  const auto add = [&](const std::string& name) {
    constexpr std::string_view first = "[0]";
    if (!name.ends_with(first)) return;
    const std::string vector = name.substr(0, name.size() - first.size());
    if (is_vector(info, vector)) vectors.push_back(vector);
  };
  for (const format::Attribute& attribute : info.attributes) add(attribute.name);
  for (const format::Alias& alias : info.aliases) add(alias.name);
  return vectors;
}

Result<std::unique_ptr<const VectorField>> VectorField::open(const format::Volume& volume, const std::string& vector,
                                                             const std::vector<std::string>& attributes,
                                                             const PartRoom& room) {
  SPLATVOL_TRY_ASSIGN(numbers, find_attributes(volume, vector, attributes));
  SPLATVOL_TRY_ASSIGN(cells, CellTetrahedra::open(volume, std::move(numbers), room));
  if (!cells) return fail_without_cells(volume);
  if (cells->unknown_cells() > 0)
    return fail(ErrorCode::unsupported, "{}: {} of its cells have shapes that this version does not know",
                volume.name(), cells->unknown_cells());
  if (cells->has_constant())
    return fail(
        ErrorCode::unsupported,
        "{}: streamlines need values that are continuous: each cell has one value: build it without --cells own",
        volume.name());
  SPLATVOL_TRY_ASSIGN(chunks, cells->chunks([](const Box&) { return true; }));
  return std::unique_ptr<const VectorField>(
      new VectorField(std::move(cells), attributes.size(), std::move(chunks), room));
}

VectorField::VectorField(std::unique_ptr<const CellTetrahedra> cells, std::size_t attributes,
                         std::vector<format::CellChunkEntry> chunks, const PartRoom& room)
    : cells_(std::move(cells)),
      attributes_(attributes),
      chunks_(std::move(chunks)),
      tree_(boxes_of(chunks_)),
      trees_(room_in(*room.table, *room.share)) {
  dvec3 largest(0);
  for (int axis = 0; axis < 3; ++axis) {
    const format::Attribute& of =
        cells_->reader().volume().info().attributes[cells_->attributes()[static_cast<std::size_t>(axis)]];
    largest[axis] = std::isnan(of.max) ? 0 : std::max(std::abs(of.min), std::abs(of.max));
  }
  largest_ = glm::length(largest);
}

void VectorField::chunks_at(const dvec3& position, std::vector<std::uint32_t>& chunks) const {
  chunks.clear();
  const double reach = cells_->reach();
  tree_.visit_near(around(position, reach), [&](std::uint32_t chunk) {
    if (squared_distance(box_of_cells(chunks_[chunk]), around(position, reach)) == 0) chunks.push_back(chunk);
  });
  std::ranges::sort(chunks);
}

Result<std::shared_ptr<const FieldChunk>> VectorField::read(std::uint32_t chunk) const {
  const auto decode = [&]() -> Result<FieldChunk> {
    const std::span entry(&chunks_[chunk], 1);
    SPLATVOL_TRY_ASSIGN(ahead, cells_->read_ahead(entry));
    SPLATVOL_TRY_ASSIGN(cells, cells_->read(entry[0]));
    cells.ranks = {};
    BoxTree tree = tree_of(cells);
    return FieldChunk{std::move(cells), std::move(tree)};
  };
  return trees_.table->get<FieldChunk>(key_of(chunk), *trees_.share, 0, decode,
                                       [](const FieldChunk& decoded) { return decoded.memory_bytes(); });
}

// Those of a step stay, however little memory there is.
void FieldReader::let_go() {
  constexpr std::size_t of_a_step = 8;
  if (held_.size() <= of_a_step) return;
  std::uint64_t sum = 0;
  for (std::size_t i = 0; i < held_.size(); ++i)
    if ((sum += held_[i].chunk->memory_bytes()) > most_held_ && i >= of_a_step) held_.resize(i);
}

Status FieldReader::read(std::uint32_t number) {
  const auto found = std::ranges::find(held_, number, &Held::number);
  if (found != held_.end()) {
    std::rotate(held_.begin(), found, found + 1);
    return {};
  }
  SPLATVOL_TRY_ASSIGN(chunk, field_.read(number));
  held_.insert(held_.begin(), {number, std::move(chunk)});
  return {};
}

// Returns null in trouble.
const FieldChunk* FieldReader::hold(std::uint32_t number, bool may_lack, Found& trouble) {
  if (may_lack && std::ranges::find(held_, number, &Held::number) == held_.end() && !field_.holds(number)) {
    lacking_ = number;
    trouble = Found::lacking;
    return nullptr;
  }
  if (const Status status = read(number); !status) {
    failure_ = status.error();
    trouble = Found::failure;
    return nullptr;
  }
  return held_.front().chunk.get();
}

FieldReader::Found FieldReader::find(const dvec3& position, const std::optional<FieldCell>& near, bool may_lack,
                                     FieldPlace& place) {
  let_go();
  if (!std::isfinite(position.x + position.y + position.z)) return Found::nothing;
  Found found = Found::nothing;
  // Only in a chunk that is looked at anyway, so that what is lacking does not depend on it.
  if (near && squared_distance(box_of_cells(field_.entry(near->chunk)), position) == 0) {
    const FieldChunk* const chunk = hold(near->chunk, may_lack, found);
    if (!chunk) return found;
    if (const auto weights = weights_in(chunk->cells.corners_of(near->tetrahedron), position)) {
      place = {chunk, near->chunk, near->tetrahedron, *weights};
      return Found::value;
    }
  }
  field_.chunks_at(position, chunks_);
  for (const std::uint32_t number : chunks_) {
    if (squared_distance(box_of_cells(field_.entry(number)), position) > 0) continue;
    const FieldChunk* const chunk = hold(number, may_lack, found);
    if (!chunk) return found;
    const Found in_chunk = find_inside(*chunk, number, position, place);
    if (in_chunk == Found::value) return in_chunk;
    if (in_chunk == Found::missing) found = in_chunk;
  }
  // What rounding has moved out of all cells.
  double distance = std::numeric_limits<double>::infinity();
  for (const std::uint32_t number : chunks_) {
    const FieldChunk* const chunk = hold(number, may_lack, found);
    if (!chunk) return found;
    find_near(*chunk, number, position, distance, place);
  }
  return std::isfinite(distance) ? Found::value : found;
}

FieldReader::Found FieldReader::find_inside(const FieldChunk& chunk, std::uint32_t number, const dvec3& position,
                                            FieldPlace& place) {
  constexpr std::uint32_t no_number = std::numeric_limits<std::uint32_t>::max();
  std::uint32_t first = no_number;
  bool is_missing = false;
  chunk.tree.visit_near(around(position, 0), [&](std::uint32_t t) {
    if (t >= first) return;
    const auto weights = weights_in(chunk.cells.corners_of(t), position);
    if (!weights) return;
    if (!has_vector(chunk.cells, t)) {
      is_missing = true;
      return;
    }
    first = t;
    place.weights = *weights;
  });
  if (first == no_number) return is_missing ? Found::missing : Found::nothing;
  place.chunk = &chunk;
  place.chunk_number = number;
  place.tetrahedron = first;
  return Found::value;
}

void FieldReader::find_near(const FieldChunk& chunk, std::uint32_t number, const dvec3& position, double& distance,
                            FieldPlace& place) const {
  std::vector<std::uint32_t> near;
  chunk.tree.visit_near(around(position, field_.cells().reach()), [&](std::uint32_t t) { near.push_back(t); });
  std::ranges::sort(near);
  for (const std::uint32_t t : near) {
    const double reach = field_.cells().reach(box_of(chunk.cells, t));
    const auto point = nearest_on(chunk.cells.corners_of(t), position, reach);
    if (!point || !(point->distance < distance) || !has_vector(chunk.cells, t)) continue;
    distance = point->distance;
    place = {&chunk, number, t, point->weights};
  }
}

}  // namespace splatvol
