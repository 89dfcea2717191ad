// Points as fixed-size records, for sorting outside of memory.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <functional>
#include <span>

#include "base/math.h"
#include "builder/mesh/boundary.h"
#include "builder/mesh/heights.h"
#include "builder/mesh/moments.h"
#include "builder/sources/source.h"

namespace splatvol {

/// Gets each piece before its points are read.
using WatchPiece = std::function<Status(Piece&)>;

/// Gets what those need that follow pieces and points from the input to their order in the file.
struct WatchPoints {
  WatchPiece piece = {};
  /// Gets each point of a piece, and its rank: the number among all points in Morton order of the point that it
  /// becomes. If it is set, records carry tags.
  std::function<Status(PointTag, std::uint64_t rank)> rank = {};
};

/// The layout of a point's record. It begins with the sample: the position, and a value for each attribute. With
/// material follow the vertex part, and for each attribute a value part, with or without its gradient; with planes, the
/// point's plane; with tags, the point's tag.
class PointRecords {
 public:
  PointRecords(std::size_t attributes, bool single_precision, bool material, bool planes = false, bool gradients = true)
      : attributes_(attributes),
        single_(single_precision),
        material_(material),
        planes_(planes),
        gradients_(gradients) {}

  /// The same layout, for records of which others are copies of one vertex.
  [[nodiscard]] PointRecords with_copies(VertexCopies copies) const {
    PointRecords layout = *this;
    layout.copies_ = copies;
    return layout;
  }
  [[nodiscard]] VertexCopies copies() const { return copies_; }

  /// The same layout with tags.
  [[nodiscard]] PointRecords with_tags(bool tags) const {
    PointRecords layout = *this;
    layout.tags_ = tags;
    return layout;
  }
  [[nodiscard]] bool has_tags() const { return tags_; }

  [[nodiscard]] std::size_t attributes() const { return attributes_; }
  [[nodiscard]] bool is_single_precision() const { return single_; }
  [[nodiscard]] bool has_material() const { return material_; }
  [[nodiscard]] bool has_planes() const { return planes_; }
  [[nodiscard]] bool has_gradients() const { return gradients_; }
  [[nodiscard]] std::size_t bytes() const {
    return number_bytes() * (3 + attributes_) + (material_ ? material_bytes() : 0) +
           (planes_ ? sizeof(BoundaryPlane) : 0) + (tags_ ? sizeof(PointTag) : 0);
  }

  [[nodiscard]] dvec3 position(const std::byte* record) const {
    return {number(record, 0), number(record, 1), number(record, 2)};
  }
  void set_position(std::byte* record, const dvec3& position) const {
    for (int axis = 0; axis < 3; ++axis) set_number(record, static_cast<std::size_t>(axis), position[axis]);
  }
  [[nodiscard]] double value(const std::byte* record, std::size_t attribute) const {
    return number(record, 3 + attribute);
  }
  void set_value(std::byte* record, std::size_t attribute, double value) const {
    set_number(record, 3 + attribute, value);
  }

  /// The bytes of position and values.
  [[nodiscard]] std::span<const std::byte> sample(const std::byte* record) const {
    return {record, number_bytes() * (3 + attributes_)};
  }

  [[nodiscard]] std::size_t position_bytes() const { return 3 * number_bytes(); }

  /// With material only.
  struct VertexPart {
    std::uint64_t block = 0;  // block_of() the cells that use the point; 0: none does
    SpatialMoments moments;
    double height = no_height;  // least_heights
  };

  /// Returns the number of a piece's block, not 0: all pieces without one are of the same.
  [[nodiscard]] static std::uint64_t block_of(const Piece& piece) { return piece.block == 0 ? 1 : piece.block; }
  struct ValuePart {
    ValueMoments moments;
    dvec3 gradient{0};  // of any length; 0 if the records have no gradients
  };
  [[nodiscard]] VertexPart vertex(const std::byte* record) const { return read<VertexPart>(record, vertex_offset()); }
  void set_vertex(std::byte* record, const VertexPart& part) const { write(record, vertex_offset(), part); }
  [[nodiscard]] std::uint64_t block(const std::byte* record) const {
    static_assert(offsetof(VertexPart, block) == 0);
    return read<std::uint64_t>(record, vertex_offset());
  }
  void set_block(std::byte* record, std::uint64_t block) const { write(record, vertex_offset(), block); }
  [[nodiscard]] ValuePart value_part(const std::byte* record, std::size_t attribute) const {
    ValuePart part;
    std::memcpy(&part, record + value_offset(attribute), value_bytes());
    return part;
  }
  void set_value_part(std::byte* record, std::size_t attribute, const ValuePart& part) const {
    std::memcpy(record + value_offset(attribute), &part, value_bytes());
  }

  /// With planes only.
  [[nodiscard]] BoundaryPlane plane(const std::byte* record) const {
    return read<BoundaryPlane>(record, value_offset(attributes_));
  }
  void set_plane(std::byte* record, const BoundaryPlane& plane) const {
    write(record, value_offset(attributes_), plane);
  }

  /// With tags only.
  [[nodiscard]] PointTag tag(const std::byte* record) const {
    return read<PointTag>(record, bytes() - sizeof(PointTag));
  }
  void set_tag(std::byte* record, PointTag tag) const { write(record, bytes() - sizeof(PointTag), tag); }

 private:
  template <class T>
  static T read(const std::byte* record, std::size_t offset) {
    T value;
    std::memcpy(&value, record + offset, sizeof(T));
    return value;
  }
  template <class T>
  static void write(std::byte* record, std::size_t offset, const T& value) {
    std::memcpy(record + offset, &value, sizeof(T));
  }

  [[nodiscard]] std::size_t number_bytes() const { return single_ ? sizeof(float) : sizeof(double); }
  [[nodiscard]] double number(const std::byte* record, std::size_t index) const {
    return single_ ? static_cast<double>(read<float>(record, index * sizeof(float)))
                   : read<double>(record, index * sizeof(double));
  }
  void set_number(std::byte* record, std::size_t index, double value) const {
    if (single_)
      write(record, index * sizeof(float), static_cast<float>(value));
    else
      write(record, index * sizeof(double), value);
  }
  [[nodiscard]] std::size_t vertex_offset() const { return number_bytes() * (3 + attributes_); }
  [[nodiscard]] std::size_t value_offset(std::size_t attribute) const {
    return vertex_offset() + sizeof(VertexPart) + attribute * value_bytes();
  }
  [[nodiscard]] std::size_t value_bytes() const { return gradients_ ? sizeof(ValuePart) : sizeof(ValueMoments); }
  [[nodiscard]] std::size_t material_bytes() const { return sizeof(VertexPart) + attributes_ * value_bytes(); }

  std::size_t attributes_;
  bool single_;
  bool material_;
  bool planes_;
  bool gradients_;
  bool tags_ = false;
  VertexCopies copies_ = VertexCopies::same_values;
};

}  // namespace splatvol
