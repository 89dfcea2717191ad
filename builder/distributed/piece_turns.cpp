#include "builder/distributed/piece_turns.h"

#include <fmt/format.h>

#include <algorithm>
#include <tuple>
#include <type_traits>
#include <utility>

#include "base/interruption.h"
#include "builder/distributed/fair_shares.h"
#include "builder/output/byte_streams.h"

namespace splatvol {
namespace {

// Samples of all ranks together, and the least of a rank: more samples make ranges more even.
constexpr std::size_t most_samples = std::size_t{1} << 18, least_samples = 1024;

template <class Ranges>
auto members_of(Ranges& ranges) requires std::is_same_v<std::remove_const_t<Ranges>, PointRanges> {
  return std::tie(ranges.box, ranges.low, ranges.high, ranges.least);
}

template <class Print>
auto members_of(Print& print) requires std::is_same_v<std::remove_const_t<Print>, RepeatedPieces::Fingerprint> {
  return std::tie(print.points, print.positions, print.box, print.tetrahedra);  // the file goes as its number
}

// Those that need no function of their own.
template <class Facts>
auto members_of(Facts& facts) requires std::is_same_v<std::remove_const_t<Facts>, InputFacts> {
  return std::tie(facts.fills, facts.brings_value_moments, facts.census, facts.has_material, facts.most_piece_bytes,
                  facts.deviation);
}

void put(ByteWriter& out, const CellCensus& cells) {
  out.put_members(numbers_of(cells));
  out.put(cells.rounded_by);
  out.put(std::uint64_t{cells.cells.size()});
  for (const auto& [name, count] : cells.cells) {
    out.put(std::vector<char>(name.begin(), name.end()));
    out.put(count);
  }
  out.put(std::uint64_t{cells.losses.size()});
  for (const std::string& line : cells.losses) out.put(std::vector<char>(line.begin(), line.end()));
}

void get(ByteReader& in, CellCensus& cells) {
  in.get_members(numbers_of(cells));
  in.get(cells.rounded_by);
  std::uint64_t types = 0;
  in.get(types);
  for (std::uint64_t t = 0; t < types; ++t) {
    std::vector<char> name;
    in.get(name);
    in.get(cells.cells[std::string(name.begin(), name.end())]);
  }
  std::uint64_t losses = 0;
  in.get(losses);
  for (std::vector<char> line; losses > 0; --losses) {
    in.get(line);
    cells.losses.emplace(line.begin(), line.end());
  }
}

Bytes bytes_of(const InputFacts& facts) {
  ByteWriter out;
  out.put_members(members_of(facts.ranges));
  out.put_members(members_of(facts.in_cells));
  out.put_members(members_of(facts));
  for (const format::PartsHash& hash : facts.values) out.put(hash.value());
  put(out, facts.cells);
  return out.bytes();
}

// Adds the facts of another rank. The hashes of values depend on the pieces of each rank, but are only compared with
// each other.
void include(ByteReader in, InputFacts& all) {
  const std::size_t attributes = all.fills.size();
  InputFacts more(attributes);
  in.get_members(members_of(more.ranges));
  in.get_members(members_of(more.in_cells));
  in.get_members(members_of(more));
  for (format::PartsHash& hash : all.values) {
    std::uint64_t value = 0;
    in.get(value);
    hash.add(value);
  }
  get(in, more.cells);

  all.ranges.include(more.ranges);
  all.in_cells.include(more.in_cells);
  for (std::size_t a = 0; a < attributes; ++a) all.fills[a] += more.fills[a];
  all.brings_value_moments = all.brings_value_moments || more.brings_value_moments;
  all.cells += more.cells;
  all.census.read += more.census.read;
  all.census.not_finite += more.census.not_finite;
  all.census.in_no_cell += more.census.in_no_cell;
  all.has_material = all.has_material || more.has_material;
  all.most_piece_bytes = std::max(all.most_piece_bytes, more.most_piece_bytes);
  all.deviation = std::max(all.deviation, more.deviation);
}

}  // namespace

PieceTurns::PieceTurns(Ranks& ranks, Source& source, const PointRecords& layout, const Workplace& place,
                       WatchPiece watch)
    : ranks_(ranks),
      source_(source),
      layout_(layout),
      watch_(std::move(watch)),
      faces_(layout, std::max(place.memory / 8, PieceFaces::least_memory()), place.folder),
      reader_(source, layout, faces_, place.memory / 16),
      spool_(layout.bytes(), place.memory / 4, place.folder),
      samples_(std::max(least_samples, most_samples / ranks.size())),
      before_(layout.attributes()) {}

Status PieceTurns::read(const std::function<void(double)>& progress) {
  source_.lend_values();
  if (layout_.has_tags()) source_.tell_whole_cells();
  SPLATVOL_TRY(select_share());
  SPLATVOL_TRY(ranks_.agree(read_own(progress)));
  // Without a selection, each rank has seen all blocks.
  if (selects_ || ranks_.is_first()) reader_.count_left_out();
  SPLATVOL_TRY(check_repeated());
  share_turns();
  InputFacts all(layout_.attributes());
  for (const Bytes& bytes : ranks_.gather_all(bytes_of(reader_.facts()))) include(ByteReader(bytes), all);
  before_ = all;
  reader_.set_facts(std::move(all));
  return reader_.check_any();
}

// Rank 0 deals for all: another rank may see a file's size otherwise.
Status PieceTurns::select_share() {
  ByteWriter dealt;
  if (ranks_.is_first())
    for (const std::vector<std::uint64_t>& share : deal_largest_first(source_.part_sizes(), ranks_.size()))
      dealt.put(share);
  const Bytes bytes = ranks_.broadcast(dealt.bytes());
  ByteReader in(bytes);
  std::vector<std::uint64_t> own;
  for (std::size_t rank = 0; rank < ranks_.size(); ++rank) {
    std::vector<std::uint64_t> share;
    in.get(share);
    selects_ = selects_ || !share.empty();
    if (rank == ranks_.rank()) own = std::move(share);
  }
  return ranks_.agree(selects_ ? source_.select(own) : Status{});
}

Status PieceTurns::read_own(const std::function<void(double)>& progress) {
  for (std::uint32_t read = 0;; ++read) {
    SPLATVOL_TRY_ASSIGN(piece, source_.next());
    if (!piece) return {};
    SPLATVOL_TRY(check_interruption());
    if (!selects_ && read % ranks_.size() != ranks_.rank()) continue;
    const double all = static_cast<double>(std::max<std::size_t>(source_.piece_count(), 1));
    progress(std::min(static_cast<double>(read) * static_cast<double>(selects_ ? ranks_.size() : 1) / all, 1.0));
    turns_.push_back({selects_ ? source_.piece_number() : Source::PieceNumber{0, read}, ranks_.rank(), 0});
    // Without a selection, the source has seen all pieces, and has found those that repeat others.
    if (selects_) prints_.push_back(RepeatedPieces::fingerprint({}, *piece));
    if (watch_) SPLATVOL_TRY(watch_(*piece));
    const auto keep_records = [&](std::span<const std::byte> records) { return keep(turns_.back(), records); };
    SPLATVOL_TRY(reader_.read(*piece, keep_records));
  }
}

Status PieceTurns::keep(Turn& turn, std::span<const std::byte> records) {
  constexpr int record_bits = 36, file_bits = 40;
  const std::uint64_t piece = std::uint64_t{turn.number.file} << file_bits ^ std::uint64_t{turn.number.in_file}
                                                                                 << record_bits;
  for (std::size_t at = 0; at < records.size(); at += layout_.bytes()) {
    const std::uint64_t number = piece + turn.records++;
    if (samples_.keeps(number)) samples_.add(number, layout_.position(records.data() + at));
  }
  return spool_.append(records);
}

// Shows rank 0 the pieces of all ranks: two files with the same points are time steps.
Status PieceTurns::check_repeated() {
  ByteWriter own;
  for (std::size_t i = 0; i < prints_.size(); ++i) {
    own.put(turns_[i].number.file);
    own.put_members(members_of(prints_[i]));
  }
  prints_ = {};
  RepeatedPieces all;
  return ranks_.gather_in_order(
      [&](const Ranks::Emit& emit) { return own.bytes().empty() ? Status{} : emit(own.bytes()); },
      [&](std::size_t, std::span<const std::byte> bytes) -> Status {
        for (ByteReader in(bytes); !in.at_end();) {
          std::uint32_t file = 0;
          in.get(file);
          RepeatedPieces::Fingerprint print;
          print.file = fmt::format("input file {}", file + 1);
          in.get_members(members_of(print));
          SPLATVOL_TRY(all.add(std::move(print)));
        }
        return {};
      });
}

void PieceTurns::share_turns() {
  std::vector<Turn> all;
  for (const std::vector<Turn>& of_rank : gather_arrays(ranks_, std::span<const Turn>(turns_)))
    all.insert(all.end(), of_rank.begin(), of_rank.end());
  std::ranges::sort(all, {}, &Turn::number);
  turns_ = std::move(all);
}

std::uint64_t PieceTurns::records() const {
  std::uint64_t records = 0;
  for (const Turn& turn : turns_) records += turn.records;
  return records;
}

void PieceTurns::add_left_out() {
  InputFacts all = before_;
  std::uint64_t left_out = reader_.facts().census.left_out;
  ranks_.sum({&left_out, 1});
  for (const Bytes& bytes : ranks_.gather_all(bytes_of(reader_.facts()))) {
    InputFacts of_rank(layout_.attributes());
    include(ByteReader(bytes), of_rank);
    all.in_cells.include(of_rank.in_cells);
  }
  all.census.left_out = left_out;
  all.census.in_no_cell -= left_out;
  reader_.set_facts(std::move(all));
}

Status PieceTurns::take(std::uint64_t count, std::vector<std::byte>& records) {
  for (std::size_t bytes = count * layout_.bytes(); bytes > 0;) {
    if (unread_.empty()) {
      SPLATVOL_TRY_ASSIGN(next, spool_.next());
      if (next.empty()) return fail(ErrorCode::invalid_argument, "records: past the end");
      unread_ = next;
    }
    const auto part = unread_.first(std::min(bytes, unread_.size()));
    records.insert(records.end(), part.begin(), part.end());
    unread_ = unread_.subspan(part.size());
    bytes -= part.size();
  }
  return {};
}

Result<PieceTurns::KeySamples> PieceTurns::sample_keys(const Cube& cube) {
  std::uint64_t limit = samples_.limit();
  for (const std::uint64_t of_rank : gather_values(ranks_, limit)) limit = std::min(limit, of_rank);
  ByteWriter own;
  for (const PositionSamples::Sample& sample : samples_.samples())
    if (sample.lot <= limit) own.put(morton_key(sample.position, cube));
  KeySamples samples{{}, PositionSamples::probability(limit)};
  SPLATVOL_TRY(ranks_.gather_in_order([&](const Ranks::Emit& emit) { return emit(own.bytes()); },
                                      [&](std::size_t, std::span<const std::byte> bytes) -> Status {
                                        for (ByteReader in(bytes); !in.at_end();) in.get(samples.keys.emplace_back());
                                        return {};
                                      }));
  std::ranges::sort(samples.keys);
  return samples;
}

}  // namespace splatvol
