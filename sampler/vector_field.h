// The vector field of the cells that a file keeps.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "base/part_table.h"
#include "base/tetrahedra.h"
#include "format/volume.h"
#include "sampler/box_tree.h"
#include "sampler/cell_tetrahedra.h"
#include "sampler/tetrahedron.h"

namespace splatvol {

/// Returns the names of a file's vectors: `U` for attributes `U[0]`, `U[1]` and `U[2]` without a `U[3]`.
[[nodiscard]] std::vector<std::string> vectors_of(const format::VolumeInfo& info);

/// A chunk of cells in which positions are found.
struct FieldChunk {
  Tetrahedra cells;
  BoxTree tree;  // of the boxes of the tetrahedra

  [[nodiscard]] std::uint64_t memory_bytes() const { return cells.memory_bytes() + tree.memory_bytes(); }
};

/// A vector that is linear in each tetrahedron of the cells, with the values of other attributes. Holds chunks,
/// decoded, as far as memory has room. Thread-safe.
class VectorField {
 public:
  /// `attributes`: names, for FieldPlace::value_of. `room`: for chunks and what they are made of. The volume must
  /// outlive the field. Fails if the file keeps no cells, if some have values of their own or shapes that this program
  /// does not know, or if it lacks an attribute or a component.
  [[nodiscard]] static Result<std::unique_ptr<const VectorField>> open(const format::Volume& volume,
                                                                       const std::string& vector,
                                                                       const std::vector<std::string>& attributes,
                                                                       const PartRoom& room);

  [[nodiscard]] std::size_t attribute_count() const { return attributes_; }

  /// The largest length that a vector may have, by the ranges of the components.
  [[nodiscard]] double largest() const { return largest_; }

  /// Returns chunks whose boxes hold the position, or nearly so, in the order of the file.
  void chunks_at(const dvec3& position, std::vector<std::uint32_t>& chunks) const;

  [[nodiscard]] bool holds(std::uint32_t chunk) const { return trees_.holds(key_of(chunk)); }
  [[nodiscard]] Result<std::shared_ptr<const FieldChunk>> read(std::uint32_t chunk) const;

  [[nodiscard]] const CellTetrahedra& cells() const { return *cells_; }
  [[nodiscard]] const format::CellChunkEntry& entry(std::uint32_t chunk) const { return chunks_[chunk]; }
  [[nodiscard]] const MemoryShare& share() const { return *trees_.share; }

 private:
  VectorField(std::unique_ptr<const CellTetrahedra> cells, std::size_t attributes,
              std::vector<format::CellChunkEntry> chunks, const PartRoom& room);
  [[nodiscard]] PartKey key_of(std::uint32_t chunk) const { return {trees_.file, format::field_chunk, chunk}; }

  std::unique_ptr<const CellTetrahedra> cells_;  // with the components, then the attributes
  std::size_t attributes_;
  double largest_;
  std::vector<format::CellChunkEntry> chunks_;
  BoxTree tree_;    // of the chunks
  PartRoom trees_;  // of FieldChunk
};

/// A tetrahedron of a field.
struct FieldCell {
  std::uint32_t chunk, tetrahedron;
};

/// A position in the cells. Valid until the reader finds another one.
struct FieldPlace {
  const FieldChunk* chunk = nullptr;
  std::uint32_t chunk_number = 0;
  std::uint32_t tetrahedron = 0;
  CornerWeights weights{};

  [[nodiscard]] FieldCell cell() const { return {chunk_number, tetrahedron}; }

  [[nodiscard]] TetrahedronCorners corners() const { return chunk->cells.corners_of(tetrahedron); }
  [[nodiscard]] dvec3 vector() const { return {of_attribute(0), of_attribute(1), of_attribute(2)}; }

  /// Returns the sum of the corners' vectors with other weights than the place has.
  [[nodiscard]] dvec3 vector_of(const CornerWeights& others) const {
    dvec3 sum(0);
    for (int axis = 0; axis < 3; ++axis) {
      const std::array<double, 4> values = chunk->cells.values_of(tetrahedron, static_cast<std::size_t>(axis));
      for (std::size_t k = 0; k < 4; ++k) sum[axis] += others[k] * values[k];
    }
    return sum;
  }
  [[nodiscard]] double value_of(std::size_t attribute) const { return of_attribute(3 + attribute); }

 private:
  [[nodiscard]] double of_attribute(std::size_t number) const {
    return value_at(chunk->cells.values_of(tetrahedron, number), weights);
  }
};

/// Finds positions. For one thread. Holds the chunks that it used last: all threads have an eighth of the field's
/// share.
class FieldReader {
 public:
  FieldReader(const VectorField& field, std::size_t threads)
      : field_(field), most_held_(field.share().capacity() / (8 * threads)) {}

  enum class Found { value, missing, nothing, lacking, failure };

  /// Finds the tetrahedron of a position. Of several, `near` counts if it is one, and else the first of the file with a
  /// value, as in sample_cells. Returns `missing` where only cells without a value are. Reads chunks that are not held,
  /// or returns `lacking` if it `may_lack` one.
  [[nodiscard]] Found find(const dvec3& position, const std::optional<FieldCell>& near, bool may_lack,
                           FieldPlace& place);

  [[nodiscard]] std::uint32_t lacking() const { return lacking_; }
  [[nodiscard]] const Error& failure() const { return *failure_; }

  /// Reads a chunk unless it is held.
  [[nodiscard]] Status read(std::uint32_t chunk);

 private:
  struct Held {
    std::uint32_t number;
    std::shared_ptr<const FieldChunk> chunk;
  };
  void let_go();
  [[nodiscard]] const FieldChunk* hold(std::uint32_t number, bool may_lack, Found& trouble);
  [[nodiscard]] static Found find_inside(const FieldChunk& chunk, std::uint32_t number, const dvec3& position,
                                         FieldPlace& place);
  void find_near(const FieldChunk& chunk, std::uint32_t number, const dvec3& position, double& distance,
                 FieldPlace& place) const;

  const VectorField& field_;
  std::uint64_t most_held_;  // bytes
  std::vector<Held> held_;   // used last first
  std::vector<std::uint32_t> chunks_;
  std::uint32_t lacking_ = 0;
  std::optional<Error> failure_;
};

}  // namespace splatvol
