#include "builder/sources/openvdb/vdb_library.h"

#include <dlfcn.h>
#include <openvdb/Exceptions.h>
#include <openvdb/io/Compression.h>
#include <openvdb/openvdb.h>
#include <openvdb/util/logging.h>

#include <cstdint>
#include <istream>
#include <string>

// OpenVDB reads a block of compressed values with unzipFromStream or bloscFromStream. A block begins with its length.
// A length below 0 stands for plain values: OpenVDB 10 copies so many bytes, and only then compares them with the
// memory of the values. The functions below have the names of these two, and the dynamic linker takes a program's
// functions before those of its libraries: the library calls them, too.
namespace splatvol {
namespace {

using ReadBlock = void (*)(std::istream&, char*, std::size_t);

/// Returns the function of the same name that comes next in the order of the dynamic linker; null if there is none.
ReadBlock next_of(ReadBlock function) {
  Dl_info info{};
  if (::dladdr(reinterpret_cast<const void*>(function), &info) == 0 || info.dli_sname == nullptr) return nullptr;
  return reinterpret_cast<ReadBlock>(::dlsym(RTLD_NEXT, info.dli_sname));
}

/// Returns the length at the stream's place, and stays there.
std::int64_t length_ahead(std::istream& in) {
  std::int64_t length = 0;
  const auto bytes = static_cast<std::streamsize>(sizeof(length));
  std::streambuf& buffer = *in.rdbuf();
  if (buffer.in_avail() >= bytes) {  // without a seek, which drops the buffer
    buffer.sgetn(reinterpret_cast<char*>(&length), bytes);
    for (std::streamsize i = 0; i < bytes; ++i) buffer.sungetc();
    return length;
  }
  const auto place = in.tellg();
  in.read(reinterpret_cast<char*>(&length), bytes);
  in.seekg(place);
  return length;
}

/// Has `read` read a block of `bytes` bytes of values to `values`, if its length is right.
void read_checked(ReadBlock read, std::istream& in, char* values, std::size_t bytes) {
  if (read == nullptr) OPENVDB_THROW(openvdb::LookupError, "no function of OpenVDB to read compressed values");
  // Compressed values are hardly longer than plain ones: OpenVDB would take memory for whatever is stated.
  const std::int64_t length = length_ahead(in);
  const std::uint64_t most_compressed = 2 * std::uint64_t{bytes} + 1024;
  const bool fits = length > 0 ? static_cast<std::uint64_t>(length) <= most_compressed
                               : std::uint64_t{0} - static_cast<std::uint64_t>(length) == bytes;
  if (!fits)
    OPENVDB_THROW(openvdb::IoError,
                  "a block of " + std::to_string(bytes) + " bytes gives its length as " + std::to_string(length));
  read(in, values, bytes);
}

}  // namespace

bool start_vdb() {
  openvdb::initialize();
  openvdb::logging::setLevel(openvdb::logging::Level::Fatal);
  return next_of(openvdb::io::unzipFromStream) != nullptr && next_of(openvdb::io::bloscFromStream) != nullptr;
}

}  // namespace splatvol

namespace openvdb {
OPENVDB_USE_VERSION_NAMESPACE
namespace OPENVDB_VERSION_NAME {
namespace io {

void unzipFromStream(std::istream& in, char* data, std::size_t numBytes) {
  static const splatvol::ReadBlock read = splatvol::next_of(unzipFromStream);
  splatvol::read_checked(read, in, data, numBytes);
}

void bloscFromStream(std::istream& in, char* data, std::size_t numBytes) {
  static const splatvol::ReadBlock read = splatvol::next_of(bloscFromStream);
  splatvol::read_checked(read, in, data, numBytes);
}

}  // namespace io
}  // namespace OPENVDB_VERSION_NAME
}  // namespace openvdb
