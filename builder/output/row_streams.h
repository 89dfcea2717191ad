// Rows of all resolutions at once, as a pass over the points brings them, put into file order.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "base/file.h"
#include "base/temp_file.h"
#include "builder/output/density.h"
#include "builder/output/member.h"
#include "builder/output/splat_rows.h"
#include "format/codec.h"
#include "format/volume_info.h"

namespace splatvol {

/// Collects the points of each segment and their splats at each level, packs them and keeps them in temporary files:
/// one for each pair, so that each is read from its beginning to its end. Chunks of the finest rows, which are the
/// file's last and more than half of it, go where they are to stay. The densities of level 0 may be fitted (density.h),
/// which needs all of its splats at once; else rows are packed as they come. Those of coarser levels stay 1: a fit
/// holds for one resolution, and most pictures mix them (docs/accuracy.md).
class RowStreams {
  struct Stream;

 public:
  /// `info`: attributes, columns and points_per_chunk; not what is only known at the end. `folder`: for the files.
  /// `finest`: gets the chunks of segment 0 at level 0, side by side; must outlive this.
  RowStreams(const format::VolumeInfo& info, bool fits, std::string folder, AtomicFile& finest);
  RowStreams(const RowStreams&) = delete;
  RowStreams& operator=(const RowStreams&) = delete;

  /// The next splat of level 0 in Morton order, where it is fitted.
  void add_splat(const SplatRow& splat) { shapes_.push_back({splat.centroid, splat.shape}); }

  /// The next points of segment 0, with their splats at level 0.
  void add_finest(const SplatRows& rows);

  /// The same of a whole chunk, which may be packed beforehand where level 0 is not fitted. Requires that before it
  /// there are whole chunks only.
  void add_packed_finest(format::Bytes chunk);

  /// Thread-safe, also beside the other functions.
  [[nodiscard]] format::Bytes pack_finest(const SplatRows& rows) const;

  /// The next point of a segment, with its splats at all levels that draw it.
  void add_point(std::size_t segment, const Member& member);

  /// Rows for one chunk of each column, on their way into a file.
  class Chunk {
    friend RowStreams;
    Stream* stream_ = nullptr;
    std::unique_ptr<SplatRows> rows_;  // null: packed already
    format::Bytes packed_;
  };

  /// Replaces `chunks`, which have been written, by those that are complete: to be packed, and written in this order.
  /// Once in a while is enough.
  void take_complete(std::vector<Chunk>& chunks) { take(chunks, false); }

  /// Thread-safe, also beside the other functions.
  void pack(Chunk& chunk) const;

  /// Allowed beside the other functions, but those below.
  [[nodiscard]] Status write(const Chunk& chunk);

  /// Fits and packs the rest; `levels`: how many there are.
  [[nodiscard]] Status finish(std::size_t levels);

  /// Bytes of all chunks but the finest rows'.
  [[nodiscard]] std::uint64_t coarse_bytes() const { return coarse_bytes_; }

  /// Gets the entries of a row's chunks and their bytes, which lie side by side; no bytes for the finest rows.
  using Visit = std::function<Status(std::span<const format::ChunkEntry>, std::span<const std::byte>)>;

  /// Visits each row in file order, and gives its disk space back. After finish.
  [[nodiscard]] Status read(const Visit& visit);

 private:
  struct Extent {
    std::uint64_t offset, bytes;
  };
  struct Stream {
    const std::vector<format::Column>* columns;
    bool finest = false;
    std::deque<Chunk> chunks;    // of which only the last may be smaller than others
    TempFile* file = nullptr;    // once there is something in it
    std::vector<Extent> packed;  // rows in the file
  };

  std::vector<Stream>& streams(std::size_t segment);
  [[nodiscard]] bool is_complete(const Chunk& chunk) const;
  SplatRows& open_chunk(Stream& stream);
  void take(std::vector<Chunk>& chunks, bool at_end);
  [[nodiscard]] bool is_fitted(std::size_t level) const { return fits_ && level == 0; }
  void fit();

  std::vector<format::Attribute> attributes_;
  std::vector<format::Column> all_columns_, resolution_columns_;
  std::size_t points_per_chunk_;
  bool fits_;
  std::string folder_;
  AtomicFile& finest_;
  std::uint64_t coarse_bytes_ = 0;
  std::deque<TempFile> files_;
  std::vector<std::vector<Stream>> streams_;       // [segment][level]
  std::vector<std::unique_ptr<SplatRows>> spare_;  // empty ones, whose memory the next chunks take
  std::vector<PlacedShape> shapes_;                // [splat of level 0], where it is fitted
  std::size_t levels_ = 0;                         // known at the end
};

}  // namespace splatvol
