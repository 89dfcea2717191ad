// Parts of a file that splats need: how they are asked for, read together, and decoded.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <variant>
#include <vector>

#include "base/error.h"
#include "base/part_table.h"
#include "format/part_kinds.h"
#include "format/volume.h"
#include "splat/record.h"

namespace splatvol {

/// Reads at a time. A disk or a server answers several reads faster together than one by one, whatever the number of
/// processors (docs/decisions/2026-11-21-threads-not-io-uring.md).
inline constexpr unsigned read_threads = 8;

/// A part that is held in a table. Its key tells the type: format::IndexPage, format::DirectoryPage, ShapePart or
/// ValuePart.
using PartPointer = std::shared_ptr<const void>;
using ShapePart = std::shared_ptr<const ShapeRow>;
using ValuePart = std::shared_ptr<const ValueRow>;

template <class Part>
[[nodiscard]] std::shared_ptr<const Part> part_as(const PartPointer& part) {
  return std::static_pointer_cast<const Part>(part);
}

/// The data, besides the key, that tells how to read a part. A directory page needs nothing more.
struct IndexPageLoad {
  format::IndexPageRef ref;
  std::uint8_t child_mask;
  std::vector<std::uint64_t> parent_counts;
  std::shared_ptr<const format::IndexPage> structure = nullptr;  // the page at another step, if it is there
};
struct DirectoryPageLoad {};
struct ChunkLoad {
  std::uint64_t row;
  int column;
  format::ChunkLocation location;
};
struct RowLoad {
  KernelKind kernel;
  std::uint32_t points;
  bool opacity;                   // of values: with those of the opacity attribute
  std::vector<ChunkLoad> chunks;  // of shapes: positions first; of values: then perhaps gradients, last the opacity
};

using PartData = std::variant<format::IndexPage, format::DirectoryPage, ShapePart, ValuePart>;

/// A part of the file on its way into a room.
struct PartLoad {
  PartKey key;
  std::variant<IndexPageLoad, DirectoryPageLoad, RowLoad> what;
  Reservation decoded;    // for the data; goes into the table with it
  Reservation working;    // for the packed bytes and for decoding
  Result<PartData> data;  // PartData() until it is read
  float error = 0;        // as CutItem::error

  [[nodiscard]] const RowLoad& row() const { return std::get<RowLoad>(what); }
};

/// Whether a part is the shapes or the values of a row.
[[nodiscard]] inline bool is_of_row(const PartKey& key) {
  return key.kind == format::row_shapes || key.kind == format::row_values;
}

/// A load run: parts that one thread reads, by few reads.
using LoadRun = std::vector<PartLoad>;

/// Makes a part without reservations.
[[nodiscard]] PartLoad load_part(const PartKey& key, std::variant<IndexPageLoad, DirectoryPageLoad, RowLoad> what);

/// Return about the bytes of a part's data, and the bytes that reading and decoding need besides. Require a part of a
/// row.
[[nodiscard]] std::uint64_t decoded_bytes(const PartLoad& part);
[[nodiscard]] std::uint64_t working_bytes(const format::Volume& volume, const PartLoad& part);

/// Returns the bytes that a part holds now that it is read.
[[nodiscard]] std::uint64_t held_bytes(const PartData& data);

/// Puts a part that was read into the table, with its reservation. Returns it, or the one that is there.
PartPointer insert(const PartRoom& room, PartLoad part);

/// Reads an index page.
[[nodiscard]] Result<format::IndexPage> read_index_page(const format::Volume& volume,
                                                        const format::SummaryAttributes& attributes,
                                                        const IndexPageLoad& load);

/// Joins parts to load runs of at most `run_bytes`, or of one part. If one request to the file's server serves many
/// ranges, the runs follow the order of the parts. Else a run is a page, or parts of rows whose chunks are next to each
/// other in the file.
[[nodiscard]] std::vector<LoadRun> runs_of(const format::Volume& volume, std::vector<PartLoad> parts,
                                           std::uint64_t run_bytes);

/// Reads and decodes a load run; sets `data` of each part. `attributes` selects the summaries of index pages. Errors
/// name the file and the part. Thread-safe.
void read_run(const format::Volume& volume, const format::SummaryAttributes& attributes, LoadRun& run);

/// The same for several load runs, read_threads at a time. Those that were not begun fail if the caller is interrupted.
void read_runs(const format::Volume& volume, const format::SummaryAttributes& attributes, std::span<LoadRun> runs);

/// Begins to fetch the bytes that a load run reads first, unless reads wait. Returns false if some have not come.
bool prefetch(const format::Volume& volume, const LoadRun& run);

}  // namespace splatvol
