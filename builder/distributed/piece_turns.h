// The pieces of an input, read by several ranks in turn.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "builder/distributed/key_ranges.h"
#include "builder/distributed/ranks.h"
#include "builder/points/piece_reader.h"
#include "builder/sorting/record_spool.h"
#include "builder/sources/repeated_pieces.h"
#include "builder/sources/source.h"

namespace splatvol {

/// Memory and folder of a part of a build.
struct Workplace {
  std::size_t memory = 0;  // bytes
  std::string folder;      // for what does not fit
};

/// The pieces of this rank, as records. Parts of the input are dealt to the ranks, the largest first. Of an input that
/// cannot be read in parts, each rank keeps every size-th piece. Each rank's pieces are in ascending order.
class PieceTurns {
 public:
  /// `watch`: gets each piece before its points are read; may be empty.
  PieceTurns(Ranks& ranks, Source& source, const PointRecords& layout, const Workplace& place, WatchPiece watch = {});

  /// Collective: reads the pieces. Then reader() has the facts of all pieces of all ranks.
  [[nodiscard]] Status read(const std::function<void(double)>& progress);

  /// Collective: adds up the facts that changed while records were left out (PieceReader::leave_out).
  void add_left_out();

  [[nodiscard]] PieceReader& reader() { return reader_; }
  [[nodiscard]] PieceFaces& faces() { return faces_; }

  /// A piece of any rank, and its records, those that may be left out among them.
  struct Turn {
    Source::PieceNumber number;
    std::uint64_t owner = 0, records = 0;
  };

  /// All pieces in the order of the input. Requires read().
  [[nodiscard]] const std::vector<Turn>& turns() const { return turns_; }
  [[nodiscard]] std::uint64_t records() const;

  /// Appends the next `count` records of this rank.
  [[nodiscard]] Status take(std::uint64_t count, std::vector<std::byte>& records);

  /// Collective: ascending keys of points of all ranks, on rank 0. Each point is among them with `probability`.
  struct KeySamples {
    std::vector<MortonKey> keys;
    double probability = 1;
  };
  [[nodiscard]] Result<KeySamples> sample_keys(const Cube& cube);

 private:
  [[nodiscard]] Status select_share();
  [[nodiscard]] Status read_own(const std::function<void(double)>& progress);
  [[nodiscard]] Status keep(Turn& turn, std::span<const std::byte> records);
  [[nodiscard]] Status check_repeated();
  void share_turns();

  Ranks& ranks_;
  Source& source_;
  PointRecords layout_;
  WatchPiece watch_;
  PieceFaces faces_;
  PieceReader reader_;
  RecordSpool spool_;
  PositionSamples samples_;
  bool selects_ = false;  // parts
  std::vector<Turn> turns_;
  std::vector<RepeatedPieces::Fingerprint> prints_;  // of this rank's pieces; the file is that of the piece's number
  InputFacts before_;                                // facts of all pieces, before records were left out
  std::span<const std::byte> unread_;                // of the spool
};

}  // namespace splatvol
