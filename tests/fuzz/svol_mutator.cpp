#include "tests/fuzz/svol_mutator.h"

#include <algorithm>
#include <cstring>
#include <map>
#include <optional>
#include <random>
#include <utility>
#include <vector>

#include "tests/fuzz/fuzz.h"
#include "tests/support/surgery.h"

namespace splatvol::fuzz {
namespace {

using format::Bytes;
using test::Dissected;
using test::Packing;
using test::Part;
using Random = std::minstd_rand;

std::size_t draw(Random& random, std::size_t below) { return random() % below; }

void mutate_bytes(Bytes& bytes, std::size_t room) {
  const std::size_t size = bytes.size();
  const std::size_t most = std::max<std::size_t>(size + room, 1);
  bytes.resize(most);
  bytes.resize(LLVMFuzzerMutate(reinterpret_cast<std::uint8_t*>(bytes.data()), size, most));
}

std::pair<Part, std::size_t> draw_part(const Dissected& file, Random& random) {
  for (;;) {
    const auto part = static_cast<Part>(draw(random, test::all_part_count));
    if (file.count(part) > 0) return {part, draw(random, file.count(part))};
  }
}

Packing draw_packing(Random& random) { return draw(random, 8) == 0 ? Packing::zstd : Packing::raw; }

}  // namespace

std::size_t mutate_volume(std::uint8_t* data, std::size_t size, std::size_t max_size, unsigned seed) {
  Random random(seed);
  const auto file = draw(random, 16) == 0 ? std::nullopt : Dissected::take_apart(bytes_of(data, size));
  if (!file) return LLVMFuzzerMutate(data, size, max_size);

  const auto [part, index] = draw_part(*file, random);
  const Bytes result = file->assemble(
      [&, &part = part, &index = index](Part p, std::size_t i, Bytes& bytes) {
        if (p != part || i != index) return;
        if (part == Part::metadata && draw(random, 2) == 0)
          test::harm_number(bytes, [&](std::size_t below) { return draw(random, below); });
        else
          mutate_bytes(bytes, max_size > size ? std::min<std::size_t>(max_size - size, 4096) : 0);
      },
      draw_packing(random));
  if (result.size() > max_size) return LLVMFuzzerMutate(data, size, max_size);
  std::memcpy(data, result.data(), result.size());
  return result.size();
}

std::size_t cross_volumes(std::span<const std::byte> first, std::span<const std::byte> second, std::span<std::byte> out,
                          unsigned seed) {
  Random random(seed);
  const auto file = Dissected::take_apart(first);
  const auto other = Dissected::take_apart(second);
  if (!file || !other) return 0;
  std::map<Part, std::vector<Bytes>> parts;
  static_cast<void>(
      other->assemble([&](Part part, std::size_t, Bytes& bytes) { parts[part].push_back(bytes); }, Packing::raw));
  const auto [part, index] = draw_part(*file, random);
  const std::vector<Bytes>& choices = parts[part];
  if (choices.empty()) return 0;
  const Bytes result = file->assemble(
      [&, &part = part, &index = index](Part p, std::size_t i, Bytes& bytes) {
        if (p == part && i == index) bytes = choices[draw(random, choices.size())];
      },
      draw_packing(random));
  if (result.size() > out.size()) return 0;
  std::ranges::copy(result, out.begin());
  return result.size();
}

}  // namespace splatvol::fuzz
