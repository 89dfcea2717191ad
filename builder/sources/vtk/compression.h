// A guard for VTK's XML parser, which believes what the header of a compressed array states.
#pragma once

#include <cstdint>

#include "base/error.h"
#include "base/file.h"

namespace splatvol {

/// How a VTK XML file writes the numbers in front of a compressed array.
struct CompressionLayout {
  bool wide = false;        // header_type="UInt64", else UInt32
  bool big_endian = false;  // byte_order="BigEndian"
};

/// Checks the header at `position`: the number of blocks, the bytes of a block, those of a shorter last one, and each
/// block's compressed bytes. Fails where it is cut off, and where VTK 9.1 would divide by zero, read a block that is
/// not there, or allocate more than the file can mean. Safe on untrusted bytes.
[[nodiscard]] Status check_compression_header(ByteSource& file, CompressionLayout layout, std::uint64_t position,
                                              bool base64);

}  // namespace splatvol
