#include "tests/fuzz/svol_mutator.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <map>
#include <optional>
#include <random>
#include <string>
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

// A number that is at the edge of a rule, or far beyond.
const char* edge_number(Random& random) {
  constexpr std::array numbers = {"0",
                                  "1",
                                  "-1",
                                  "2",
                                  "3",
                                  "64",
                                  "65",
                                  "128",
                                  "0.5",
                                  "1.5",
                                  "-0.0",
                                  "1e-60",
                                  "1e60",
                                  "1e102",
                                  "-1e102",
                                  "1e300",
                                  "-1e308",
                                  "1e-320",
                                  "65535",
                                  "65536",
                                  "16777216",
                                  "4294967295",
                                  "4294967296",
                                  "281474976710655",
                                  "281474976710656",
                                  "18446744073709551615",
                                  "null",
                                  "[]",
                                  "{}",
                                  "\"a\"",
                                  "true"};
  return numbers[draw(random, numbers.size())];
}

// Replaces a number in JSON text.
void mutate_number(Bytes& bytes, Random& random) {
  std::string text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  const std::size_t begin = text.find_first_of("0123456789", draw(random, text.size() + 1));
  if (begin == std::string::npos) return;
  const std::size_t end = std::min(text.find_first_not_of("0123456789.e-+", begin), text.size());
  text.replace(begin, end - begin, edge_number(random));
  const auto raw = std::as_bytes(std::span(text));
  bytes.assign(raw.begin(), raw.end());
}

void mutate_bytes(Bytes& bytes, std::size_t room) {
  const std::size_t size = bytes.size();
  const std::size_t most = std::max<std::size_t>(size + room, 1);
  bytes.resize(most);
  bytes.resize(LLVMFuzzerMutate(reinterpret_cast<std::uint8_t*>(bytes.data()), size, most));
}

// A part of a file that has it.
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
          mutate_number(bytes, random);
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
