// A guard for VTK's XML parser, which trusts the header of a compressed array.
#pragma once

#include <cstdint>

#include "base/error.h"
#include "base/file.h"

namespace splatvol {

/// How a VTK XML file writes the numbers in the header of a compressed array.
struct CompressionLayout {
  bool wide = false;        // header_type="UInt64", not UInt32
  bool big_endian = false;  // byte_order="BigEndian"
};

/// Checks the header at `offset`, and returns the unpacked bytes that it states. It holds the number of compressed
/// blocks, their unpacked bytes, the unpacked bytes of a shorter last one (0: none), and the packed bytes of each.
/// Fails if the header or the data is cut off. Fails also if VTK 9.1 would divide by zero, read a compressed block that
/// is not there, or allocate more than such a file can need. Safe on untrusted bytes.
[[nodiscard]] Result<double> check_compression_header(ByteSource& file, CompressionLayout layout, std::uint64_t offset,
                                                      bool base64);

/// Checks that an array without compression ends within the file, and returns the number of its bytes. This is at
/// `offset`, followed by the bytes. Safe on untrusted bytes.
[[nodiscard]] Result<double> check_uncompressed_array(ByteSource& file, CompressionLayout layout, std::uint64_t offset,
                                                      bool base64);

}  // namespace splatvol
