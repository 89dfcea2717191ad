#include "builder/cells/cell_form.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>

#include "format/codec.h"

namespace splatvol {
namespace {

constexpr int word_bits = 32;
constexpr int least_rank_bits = 16;  // the code begins behind two words
constexpr int most_rank_bits = 48;

__extension__ using Wide = unsigned __int128;

constexpr std::size_t polyhedron_words = 16, head_words = 4;  // of a record, and of its rank, hash and place
constexpr std::size_t body_bytes = (polyhedron_words - head_words) * sizeof(CellWord);
constexpr std::uint64_t hash_mask = (std::uint64_t{1} << 55) - 1;  // a key of a sort has as many bits

const std::byte* body_of(const CellWord* record) { return reinterpret_cast<const std::byte*>(record + head_words); }

}  // namespace

CellForm::CellForm(format::CellShape shape, format::CellField field, std::uint64_t rank_end)
    : shape_(shape),
      field_(field),
      corners_(format::corners_of(shape)),
      words_(polyhedron_words),
      rank_bits_(std::clamp(static_cast<int>(std::bit_width(rank_end)), least_rank_bits, most_rank_bits)) {
  if (is_of_polyhedra()) return;
  permutations_ = static_cast<std::uint32_t>(format::permutations_of(shape).size());
  const auto code_bits = static_cast<int>(std::bit_width(format::split_end(shape) * permutations_ * 3 - 1));
  const int bits = static_cast<int>(corners_ + (field == format::CellField::constant ? 1 : 0)) * rank_bits_;
  const int words = (bits + code_bits + word_bits - 1) / word_bits;
  words_ = static_cast<std::size_t>(words);
  code_bits_ = words * word_bits - bits;
}

void CellForm::append(const RankedCell& cell, std::vector<CellWord>& records) const {
  std::uint64_t bits = 0;
  int held = 0;
  const auto put_part = [&](std::uint64_t number, int width) {
    bits = bits << width | number;
    held += width;
    if (held >= word_bits) records.push_back(static_cast<CellWord>(bits >> (held -= word_bits)));
  };
  const auto put = [&](std::uint64_t number, int width) {
    if (width > word_bits) put_part(number >> word_bits, width - word_bits);
    put_part(static_cast<CellWord>(number), std::min(width, word_bits));
  };
  if (field_ == format::CellField::constant) put(cell.point, rank_bits_);
  for (std::size_t k = 0; k < corners_; ++k) put(cell.ranks[k], rank_bits_);
  const std::uint32_t order = cell.split * permutations_ + cell.permutation;
  put(order * 3 + static_cast<std::uint32_t>(cell.sign + 1), code_bits_);
}

// In front of the bytes of all records is a byte: how many there are.
std::uint64_t CellForm::append(const Polyhedron& polyhedron, std::vector<CellWord>& records) const {
  std::vector<std::byte> bytes(1);
  [[maybe_unused]] const bool is_kept = put_polyhedron(polyhedron, bytes);
  const std::uint64_t hash = format::hash_bytes(std::span(bytes).subspan(2));  // behind the sign
  const std::size_t count = (bytes.size() + body_bytes - 1) / body_bytes;
  bytes[0] = static_cast<std::byte>(count);
  bytes.resize(count * body_bytes);
  const std::uint64_t rank = field_ == format::CellField::constant ? polyhedron.point : polyhedron.corners[0];
  for (std::size_t place = 0; place < count; ++place) {
    const Wide head = Wide{rank} << (4 * word_bits - rank_bits_) | Wide{(hash & hash_mask) << 8 | place} << 2;
    for (int word = 3; word >= 0; --word) records.push_back(static_cast<CellWord>(head >> word * word_bits));
    std::array<CellWord, polyhedron_words - head_words> body;
    std::memcpy(body.data(), bytes.data() + place * body_bytes, body_bytes);
    records.insert(records.end(), body.begin(), body.end());
  }
  return hash;
}

std::size_t CellForm::records_of(const CellWord* record) const {
  return is_of_polyhedra() ? std::to_integer<std::size_t>(body_of(record)[0]) : 1;
}

std::size_t CellForm::corners_of(const CellWord* record) const {
  return is_of_polyhedra() ? std::to_integer<std::size_t>(body_of(record)[2]) : corners_;
}

RankedCells CellForm::read(std::span<const CellWord> records) const {
  RankedCells cells{{shape_, field_, {}, {}, {}}, {}, {}};
  format::CellChunk& chunk = cells.chunk;
  if (is_of_polyhedra()) {
    read_polyhedra(records, cells);
    return cells;
  }
  const std::size_t size = records.size() / words_;
  chunk.corners.resize(size * corners_);
  cells.permutations.resize(size);
  cells.signs.resize(size);
  if (shape_ != format::CellShape::tetrahedron) chunk.splits.resize(size);
  if (field_ == format::CellField::constant) chunk.points.resize(size);
  const CellWord* word = records.data();
  std::uint64_t bits = 0, *corner = chunk.corners.data();
  int held = 0;
  const auto take_part = [&](int width) {
    if (held < width) bits = bits << word_bits | *word++, held += word_bits;
    held -= width;
    return bits >> held & ((std::uint64_t{1} << width) - 1);
  };
  const auto take = [&](int width) {
    const std::uint64_t high = width > word_bits ? take_part(width - word_bits) << word_bits : 0;
    return high | take_part(std::min(width, word_bits));
  };
  for (std::size_t i = 0; i < size; ++i) {
    if (field_ == format::CellField::constant) chunk.points[i] = take(rank_bits_);
    for (std::size_t k = 0; k < corners_; ++k) *corner++ = take(rank_bits_);
    const auto code = static_cast<std::uint32_t>(take(code_bits_)), order = code / 3;
    cells.signs[i] = static_cast<std::int8_t>(static_cast<int>(code % 3) - 1);
    cells.permutations[i] = static_cast<format::Permutation>(order % permutations_);
    if (!chunk.splits.empty()) chunk.splits[i] = static_cast<format::CellSplit>(order / permutations_);
  }
  return cells;
}

void CellForm::read_polyhedra(std::span<const CellWord> records, RankedCells& cells) const {
  format::CellChunk& chunk = cells.chunk;
  Polyhedron polyhedron;
  std::vector<std::byte> bytes;
  while (!records.empty()) {
    bytes.clear();
    for (std::size_t left = records_of(records.data()); left > 0; --left, records = records.subspan(words_))
      bytes.insert(bytes.end(), body_of(records.data()), body_of(records.data()) + body_bytes);
    std::span<const std::byte> rest = std::span(bytes).subspan(1);
    get_polyhedron(rest, polyhedron);
    chunk.corners.insert(chunk.corners.end(), polyhedron.corners.begin(), polyhedron.corners.end());
    chunk.ends.push_back(static_cast<std::uint32_t>(chunk.corners.size()));
    chunk.splits.push_back(polyhedron.apex);
    chunk.triangles.insert(chunk.triangles.end(), polyhedron.triangles.begin(), polyhedron.triangles.end());
    if (field_ == format::CellField::constant) chunk.points.push_back(polyhedron.point);
    cells.signs.push_back(static_cast<std::int8_t>(polyhedron.sign));
  }
}

}  // namespace splatvol
