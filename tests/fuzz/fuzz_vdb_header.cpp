// The check of an OpenVDB file that comes before OpenVDB's reader.
#include "base/file.h"
#include "builder/sources/openvdb/vdb_header.h"
#include "tests/fuzz/fuzz.h"
#include "tests/support/memory_source.h"

using namespace splatvol;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto file = memory_source(fuzz::bytes_of(data, size), "fuzz");
  static_cast<void>(check_vdb_header(*file));
  return 0;
}
