#include "streamer/store/row_bytes.h"

#include "format/columns.h"

namespace splatvol {
namespace {

constexpr std::uint64_t records_per_block = 16;  // at least, in nearly all rows

constexpr std::uint64_t opacity_bytes(bool opacity) { return opacity ? sizeof(OpacityValue) : 0; }

constexpr std::uint64_t shape_bytes(KernelKind kernel) {
  return kernel == KernelKind::octant ? sizeof(OctantShape) : sizeof(MomentsShape);
}

}  // namespace

std::uint64_t shape_row_bytes(KernelKind kernel, std::uint64_t points) {
  return sizeof(ShapeRow) + points * shape_bytes(kernel) + (points / records_per_block + 1) * sizeof(RecordBlock);
}

std::uint64_t value_row_bytes(KernelKind kernel, std::uint64_t points, bool opacity) {
  return sizeof(ValueRow) + points * (record_bytes(kernel) - shape_bytes(kernel) + opacity_bytes(opacity));
}

std::uint64_t held_bytes(const ShapeRow& row) { return sizeof(ShapeRow) + row.memory_bytes(); }
std::uint64_t held_bytes(const ValueRow& row) { return sizeof(ValueRow) + row.memory_bytes(); }

// Positions, limits, packed positions, and an integer of 8 bytes for each point while a column is unpacked.
std::uint64_t shape_decoding_bytes(KernelKind kernel, std::uint64_t points, std::uint64_t unpacked_bytes) {
  const std::uint64_t each = sizeof(dvec3) + sizeof(float) + sizeof(PackedPosition) + sizeof(std::uint64_t);
  return unpacked_bytes + points * (each + (kernel == KernelKind::octant ? 2 : sizeof(SplatShape)));
}

std::uint64_t value_decoding_bytes(KernelKind kernel, std::uint64_t points, std::uint64_t unpacked_bytes) {
  const std::uint64_t each = kernel == KernelKind::octant ? sizeof(float) + sizeof(vec3) : sizeof(SplatValue);
  return unpacked_bytes + points * (each + sizeof(std::uint64_t));
}

std::uint64_t most_clipped_bytes(KernelKind kernel, std::uint64_t splats, bool opacity) {
  return sizeof(ShapeRow) + sizeof(ValueRow) +
         splats * (record_bytes(kernel) + opacity_bytes(opacity) + sizeof(RecordBlock));
}

}  // namespace splatvol
