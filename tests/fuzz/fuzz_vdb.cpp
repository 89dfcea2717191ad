// Voxels from an OpenVDB file, read by OpenVDB. The input names a file that OpenVDB writes, and the changes of its
// bytes.
#include <openvdb/io/Stream.h>
#include <openvdb/openvdb.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <new>
#include <sstream>

#include "base/vdb_grid.h"
#include "builder/sources/openvdb/vdb_library.h"
#include "builder/sources/openvdb/vdb_source.h"
#include "tests/fuzz/fuzz.h"
#include "tests/fuzz/read_source.h"

using namespace splatvol;

// OpenVDB takes memory for what a file states. In splatvol-read a limit of the process turns that into bad_alloc; under
// AddressSanitizer, operator new would end the fuzzer instead.
namespace {

void* allocate(std::size_t bytes) {
  constexpr std::size_t most_bytes = std::size_t{1} << 30;
  void* block = bytes > most_bytes ? nullptr : std::malloc(std::max<std::size_t>(bytes, 1));
  if (!block) throw std::bad_alloc();
  return block;
}

}  // namespace

void* operator new(std::size_t bytes) { return allocate(bytes); }
void* operator new[](std::size_t bytes) { return allocate(bytes); }
void operator delete(void* block) noexcept { std::free(block); }
void operator delete[](void* block) noexcept { std::free(block); }
void operator delete(void* block, std::size_t) noexcept { std::free(block); }
void operator delete[](void* block, std::size_t) noexcept { std::free(block); }

// What the C++ library itself takes with operator new may come back to the functions above.
extern "C" const char* __asan_default_options() { return "alloc_dealloc_mismatch=0"; }

namespace {

using openvdb::Coord;

constexpr std::uint32_t kinds = 6;

/// A brick whose values differ, one voxel far away, and a tile.
template <class Grid>
openvdb::GridBase::Ptr make_grid(bool half) {
  using Value = typename Grid::ValueType;
  const auto grid = splatvol::make_vdb_grid<Grid>();
  for (int i = 0; i < 100; ++i) grid->tree().setValueOn(Coord(i % 8, i / 8 % 8, i / 64), Value(i));
  grid->tree().setValueOn(Coord(5000, 0, -1), Value(1));
  grid->tree().addTile(1, Coord(64, 64, 64), Value(2), true);
  grid->setName("value");
  grid->setSaveFloatAsHalf(half);
  return grid;
}

openvdb::GridBase::Ptr make_grid(std::uint32_t kind) {
  switch (kind) {
    case 0:
      return make_grid<openvdb::FloatGrid>(false);
    case 1:
      return make_grid<openvdb::FloatGrid>(true);
    case 2:
      return make_grid<openvdb::DoubleGrid>(false);
    case 3:
      return make_grid<openvdb::Int32Grid>(false);
    case 4:
      return make_grid<openvdb::BoolGrid>(false);
    default:
      return make_grid<openvdb::Vec3SGrid>(false);
  }
}

std::string write(std::uint32_t kind, std::uint32_t compression) {
  std::ostringstream text(std::ios::binary);
  openvdb::io::Stream stream(text);
  stream.setCompression(compression);
  stream.write({make_grid(kind)});
  return text.str();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  fuzz::require(start_vdb(), "OpenVDB checks the lengths of blocks");
  fuzz::Input input(fuzz::bytes_of(data, size));
  const std::uint32_t kind = input.take_in(0, kinds - 1);
  const std::array<std::uint32_t, 4> compressions = {openvdb::io::COMPRESS_NONE, openvdb::io::COMPRESS_ACTIVE_MASK,
                                                     openvdb::io::COMPRESS_ZIP | openvdb::io::COMPRESS_ACTIVE_MASK,
                                                     openvdb::io::COMPRESS_BLOSC | openvdb::io::COMPRESS_ACTIVE_MASK};
  std::string bytes = write(kind, compressions[input.take_in(0, compressions.size() - 1)]);
  while (!input.rest().empty()) {
    const auto place = input.take<std::uint16_t>() % bytes.size();
    const auto width = std::size_t{1} << input.take_in(0, 3);
    const auto value = input.take<std::uint64_t>();
    std::memcpy(&bytes[place], &value, std::min(width, bytes.size() - place));
  }
  const fuzz::NamedBytes file(std::as_bytes(std::span(bytes)));
  fuzz::read_all(open_vdb_files({file.path()}, {}));
  return 0;
}
