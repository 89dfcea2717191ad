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
constexpr std::size_t most_words = 15;  // a hexahedron: nine ranks, and 26 bits

__extension__ using Wide = unsigned __int128;

constexpr std::size_t polyhedron_words = 16, head_words = 4;  // of a record, and of its rank, hash and place
constexpr std::size_t body_bytes = (polyhedron_words - head_words) * sizeof(CellWord);
constexpr std::uint64_t hash_mask = (std::uint64_t{1} << 55) - 1;  // a key of a sort has as many bits

// Puts numbers side by side into words.
class BitWriter {
 public:
  explicit BitWriter(CellWord* words) : words_(words) {}

  void put(std::uint64_t number, int width) {
    if (width > word_bits) put_part(number >> word_bits, width - word_bits);
    put_part(static_cast<CellWord>(number), std::min(width, word_bits));
  }
  /// Ends the last word, which may have fewer bits.
  void finish() {
    if (held_ > 0) *words_ = static_cast<CellWord>(bits_ & ((std::uint64_t{1} << held_) - 1));
  }

 private:
  void put_part(std::uint64_t number, int width) {
    bits_ = bits_ << width | number;
    held_ += width;
    if (held_ < word_bits) return;
    held_ -= word_bits;
    *words_++ = static_cast<CellWord>(bits_ >> held_);
  }

  CellWord* words_;
  int held_ = 0;
  std::uint64_t bits_ = 0;
};

// Takes them out again.
class BitReader {
 public:
  BitReader(const CellWord* words, int bits) : words_(words), left_(bits) {}

  std::uint64_t take(int width) {
    const std::uint64_t high = width > word_bits ? take_part(width - word_bits) << word_bits : 0;
    return high | take_part(std::min(width, word_bits));
  }

 private:
  std::uint64_t take_part(int width) {
    if (held_ < width) {
      const int more = std::min(left_, word_bits);
      bits_ = bits_ << more | *words_++;
      held_ += more;
      left_ -= more;
    }
    held_ -= width;
    return bits_ >> held_ & ((std::uint64_t{1} << width) - 1);
  }

  const CellWord* words_;
  int left_, held_ = 0;
  std::uint64_t bits_ = 0;
};

const std::byte* body_of(const CellWord* record) { return reinterpret_cast<const std::byte*>(record + head_words); }

}  // namespace

CellForm::CellForm(format::CellShape shape, format::CellField field, std::uint64_t rank_end)
    : shape_(shape),
      field_(field),
      corners_(format::corners_of(shape)),
      words_(polyhedron_words),
      rank_bits_(std::clamp(static_cast<int>(std::bit_width(rank_end)), least_rank_bits, most_rank_bits)) {
  if (is_of_polyhedra()) return;
  permutations_ = format::permutations_of(shape).size();
  code_bits_ = static_cast<int>(std::bit_width(format::split_end(shape) * permutations_ * 3 - 1));
  const std::size_t ranks = corners_ + (field == format::CellField::constant ? 1 : 0);
  bits_ = static_cast<int>(ranks) * rank_bits_ + code_bits_;
  words_ = static_cast<std::size_t>((bits_ + word_bits - 1) / word_bits);
}

void CellForm::append(const RankedCell& cell, std::vector<CellWord>& records) const {
  std::array<CellWord, most_words> words;
  BitWriter writer(words.data());
  if (field_ == format::CellField::constant) writer.put(cell.point, rank_bits_);
  for (std::size_t k = 0; k < corners_; ++k) writer.put(cell.ranks[k], rank_bits_);
  const auto order = static_cast<std::uint32_t>(cell.split * permutations_ + cell.permutation);
  writer.put(order * 3 + static_cast<std::uint32_t>(cell.sign + 1), code_bits_);
  writer.finish();
  records.insert(records.end(), words.begin(), words.begin() + static_cast<std::ptrdiff_t>(words_));
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
  std::uint64_t* corner = chunk.corners.data();
  for (std::size_t i = 0; i < size; ++i) {
    BitReader reader(records.data() + i * words_, bits_);
    if (field_ == format::CellField::constant) chunk.points[i] = reader.take(rank_bits_);
    for (std::size_t k = 0; k < corners_; ++k) *corner++ = reader.take(rank_bits_);
    const auto code = static_cast<std::uint32_t>(reader.take(code_bits_)), order = code / 3;
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
