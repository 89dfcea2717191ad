// Drawing records: splats as rasterizers read them. A row of the file becomes records once, and stays.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <variant>
#include <vector>

#include "base/math.h"
#include "splat/log_code.h"
#include "splat/shape.h"
#include "splat/splat.h"

namespace splatvol {

/// A position in a block: signed offsets of 21 bits from the block's origin, in the block's steps, stored plus 2^20.
/// x is in bits 0 to 20, y in bits 21 to 41, z in bits 42 to 62.
struct PackedPosition {
  std::uint32_t low = 0, high = 0;

  [[nodiscard]] static PackedPosition pack(const glm::ivec3& offset);
  [[nodiscard]] glm::ivec3 offset() const;
};

/// The largest offset of a packed position along an axis, either way.
inline constexpr int largest_offset = (1 << 20) - 1;

/// Consecutive records whose positions have a common origin.
struct RecordBlock {
  dvec3 origin;           // world units
  double step = 0;        // drawing units
  std::uint32_t end = 0;  // the number of the record behind the last
};

/// The shape of a splat of the kernel `moments`. Lengths are in drawing units.
struct MomentsShape {
  PackedPosition position;                   // of the centroid
  std::array<std::uint32_t, 2> orientation;  // as PackedOrientation
  std::uint16_t mass;                        // log code of volume times density; 0 draws nothing
  std::array<std::uint16_t, 3> deviations;   // log codes; along the principal axes, descending
  std::uint32_t boundary;                    // 3 signed numbers of 10 bits / 128, lowest first: SplatShape::boundary
};
static_assert(sizeof(MomentsShape) == 28);

/// The value of a splat of the kernel `moments`, as stored.
struct MomentsValue {
  float mean;
  std::uint16_t deviation;                  // log code
  std::uint8_t coverage;                    // / 255: share of the mass that has a value; 0 draws nothing
  std::array<std::int8_t, 3> correlations;  // / 127: of the value with each principal axis
  std::array<std::uint8_t, 2> unused = {};
};
static_assert(sizeof(MomentsValue) == 12);

/// The shape of a splat of the kernel `octant`, in drawing units.
struct OctantShape {
  PackedPosition position;
  float size;  // d: thickness and diameter scale
};
static_assert(sizeof(OctantShape) == 12);

/// The value of a splat of the kernel `octant`, as stored.
struct OctantValue {
  float value;             // NaN: missing, draws nothing
  std::uint32_t gradient;  // direction of the value's gradient, for lighting: 4 signed bytes / 127, the last 0; 0: none
};
static_assert(sizeof(OctantValue) == 8);

/// The value of the opacity attribute of a splat, as stored. Of either kernel.
struct OpacityValue {
  float mean;
  std::uint16_t deviation;  // log code
  std::uint8_t coverage;    // / 255: share of the mass that has a value
  std::uint8_t unused = 0;
};
static_assert(sizeof(OpacityValue) == 8);

/// Bytes of a record: shape and value.
[[nodiscard]] constexpr std::size_t record_bytes(KernelKind kernel) {
  return kernel == KernelKind::octant ? sizeof(OctantShape) + sizeof(OctantValue)
                                      : sizeof(MomentsShape) + sizeof(MomentsValue);
}
static_assert(record_bytes(KernelKind::moments) == 40);

/// A unit quaternion in 62 bits: bits 0 and 1 are the index of the component (x, y, z, w) with the largest magnitude,
/// which is positive and left out. The others follow in this order, with 20 bits each; a code u means
/// (u / (2^19 - 1) - 1) sqrt(1/2).
struct PackedOrientation {
  [[nodiscard]] static std::array<std::uint32_t, 2> pack(const glm::dquat& orientation);
  [[nodiscard]] static glm::dquat unpack(const std::array<std::uint32_t, 2>& packed);
};

/// A splat of the kernel `moments` in numbers, for what is not a rasterizer. Lengths are in drawing units; the density
/// is in the mass.
struct MomentsSplat : SplatShape {
  dvec3 center{0};   // centroid, relative to an origin
  double value = 0;  // mean, stored value
  double value_deviation = 0;
  dvec3 correlations{0};  // of the value with the position along each principal axis
};

/// Returns the value of a material.
[[nodiscard]] inline SplatValue value_of(const MomentsSplat& m) {
  return {m.value, m.value_deviation, m.correlations, 0, 1};
}

/// Shapes of the records of a row, or of a part of it that was clipped. Never changes.
class ShapeRow {
 public:
  using Records = std::variant<std::vector<MomentsShape>, std::vector<OctantShape>>;

  ShapeRow(Records records, std::vector<RecordBlock> blocks, double mass_scale = 0, double deviation_scale = 0);

  /// Different for any two rows of a process.
  [[nodiscard]] std::uint64_t id() const { return id_; }
  [[nodiscard]] std::size_t size() const;
  [[nodiscard]] const Records& records() const { return records_; }
  [[nodiscard]] std::span<const RecordBlock> blocks() const { return blocks_; }

  /// Scales of log codes, in drawing units.
  [[nodiscard]] double mass_scale() const { return mass_scale_; }
  [[nodiscard]] double deviation_scale() const { return deviation_scale_; }

  [[nodiscard]] std::uint64_t memory_bytes() const;

 private:
  std::uint64_t id_;
  Records records_;
  std::vector<RecordBlock> blocks_;
  double mass_scale_, deviation_scale_;
};

/// The values of the opacity attribute of a row's records.
struct OpacityValues {
  std::vector<OpacityValue> records;  // empty: there is no such attribute
  double deviation_scale = 0;         // of log codes, in stored values
};

/// Values of the records of a row. Never changes.
class ValueRow {
 public:
  using Records = std::variant<std::vector<MomentsValue>, std::vector<OctantValue>>;

  explicit ValueRow(Records records, double deviation_scale = 0, OpacityValues opacity = {});

  /// Different for any two rows of a process, shapes or values.
  [[nodiscard]] std::uint64_t id() const { return id_; }
  [[nodiscard]] std::size_t size() const;
  [[nodiscard]] const Records& records() const { return records_; }

  /// Scale of log codes, in stored values.
  [[nodiscard]] double deviation_scale() const { return deviation_scale_; }

  [[nodiscard]] const OpacityValues& opacity() const { return opacity_; }

  [[nodiscard]] std::uint64_t memory_bytes() const;

 private:
  std::uint64_t id_;
  Records records_;
  double deviation_scale_;
  OpacityValues opacity_;
};

/// Shapes and values of the same records.
struct RecordRow {
  std::shared_ptr<const ShapeRow> shapes;
  std::shared_ptr<const ValueRow> values;

  [[nodiscard]] bool operator==(const RecordRow&) const = default;
};

/// Consecutive records of one block.
struct DrawRange {
  RecordRow row;
  std::uint32_t block = 0;
  std::uint32_t begin = 0, count = 0;  // records of the row

  [[nodiscard]] bool operator==(const DrawRange&) const = default;
};

/// The ranges that a frame draws, back to front: no splat of a node hides one of a node that comes later.
struct DrawList {
  std::vector<DrawRange> ranges;
  std::uint64_t splats = 0;
};

/// Appends records [begin, begin + count) of a row, one range for each block.
void append(DrawList& list, const RecordRow& row, std::uint32_t begin, std::uint32_t count);

/// Consecutive points in blocks.
struct BlockedPositions {
  std::vector<RecordBlock> blocks;
  std::vector<PackedPosition> positions;
};

/// Splits points into blocks: in each, a step is at most 1/32 of the smallest limit that is not 0. A block of one point
/// has step 0. `positions`: world units; `limits`: drawing units; `length`: of a drawing unit, in world units. Requires
/// finite positions.
[[nodiscard]] BlockedPositions make_blocks(std::span<const dvec3> positions, std::span<const float> limits,
                                           double length);

/// Packs materials whose centres are relative to `origin` (world units), with their values of the opacity attribute.
/// Numbers come back as precisely as codes hold them: the largest mass and deviation exactly in single precision,
/// others within a factor 2^(1/256).
[[nodiscard]] RecordRow pack_row(std::span<const MomentsSplat> materials, const dvec3& origin, double length,
                                 OpacityValues opacity = {});

/// The same for splats of the kernel octant.
[[nodiscard]] RecordRow pack_row(std::span<const OctantSplat> splats, const dvec3& origin, double length,
                                 OpacityValues opacity = {});

/// Returns a record in numbers, relative to the origin of its block. Requires a row of the kernel moments.
[[nodiscard]] MomentsSplat unpack(const RecordRow& row, std::uint32_t record);

/// The same for the kernel octant.
[[nodiscard]] OctantSplat unpack_octant(const RecordRow& row, std::uint32_t record);

/// Returns a bound on how far a splat reaches from its centroid, in drawing units. `deviation_scale`: of its row.
[[nodiscard]] double reach_of(const MomentsShape& shape, double deviation_scale);

/// Returns the block that holds a record. Requires record < row.shapes->size().
[[nodiscard]] std::uint32_t block_of(const ShapeRow& row, std::uint32_t record);

}  // namespace splatvol
