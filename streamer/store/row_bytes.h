// The memory of rows, for budgets.
#pragma once

#include <cstdint>

#include "format/volume_info.h"
#include "splat/record.h"

namespace splatvol {

/// Return the bytes of a row's shapes and of its values. Few rows have so many blocks that their shapes need more.
/// `opacity`: with the values of the opacity attribute.
[[nodiscard]] std::uint64_t shape_row_bytes(KernelKind kernel, std::uint64_t points);
[[nodiscard]] std::uint64_t value_row_bytes(KernelKind kernel, std::uint64_t points, bool opacity);

/// Return the bytes that a decoded row holds.
[[nodiscard]] std::uint64_t held_bytes(const ShapeRow& row);
[[nodiscard]] std::uint64_t held_bytes(const ValueRow& row);

/// Return the bytes that decoding needs besides the row and the packed bytes. `unpacked_bytes`: of its chunks together.
[[nodiscard]] std::uint64_t shape_decoding_bytes(KernelKind kernel, std::uint64_t points, std::uint64_t unpacked_bytes);
[[nodiscard]] std::uint64_t value_decoding_bytes(KernelKind kernel, std::uint64_t points, std::uint64_t unpacked_bytes);

/// Returns the most bytes that a clipped row of so many splats holds: each may be in a block of its own.
[[nodiscard]] std::uint64_t most_clipped_bytes(KernelKind kernel, std::uint64_t splats, bool opacity);

}  // namespace splatvol
