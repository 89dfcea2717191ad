// A whole .svol file: opened, read part by part, and verified.
#include "base/file.h"
#include "format/volume.h"
#include "tests/fuzz/fuzz.h"
#include "tests/fuzz/svol_mutator.h"
#include "tests/support/explorer.h"
#include "tests/support/memory_source.h"

using namespace splatvol;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto volume = format::Volume::open(memory_source(fuzz::bytes_of(data, size), "fuzz"));
  if (!volume) return 0;
  const Status verified = (*volume)->verify([](double) {});
  const test::Exploration read = test::explore_volume(**volume);
  fuzz::require(read.broken.empty(), read.broken);
  fuzz::require(!verified || read.all_read, "what verify accepts can be read");
  static_cast<void>((*volume)->geometry_hash());
  return 0;
}

extern "C" std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size, std::size_t max_size,
                                               unsigned seed) {
  return fuzz::mutate_volume(data, size, max_size, seed);
}

extern "C" std::size_t LLVMFuzzerCustomCrossOver(const std::uint8_t* data1, std::size_t size1,
                                                 const std::uint8_t* data2, std::size_t size2, std::uint8_t* out,
                                                 std::size_t max_size, unsigned seed) {
  return fuzz::cross_volumes(fuzz::bytes_of(data1, size1), fuzz::bytes_of(data2, size2),
                             std::as_writable_bytes(std::span(out, max_size)), seed);
}
