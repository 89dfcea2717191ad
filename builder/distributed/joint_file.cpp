#include "builder/distributed/joint_file.h"

#include <cstring>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "base/interruption.h"
#include "builder/output/block_spool.h"
#include "builder/output/index_stream.h"
#include "format/volume.h"
#include "format/volume_writer.h"

namespace splatvol {
namespace {

// Where the rows of this rank go.
struct RowPlaces {
  std::vector<std::uint64_t> offsets;  // [segment and level, in the order of the file]: from the first row on
  std::uint64_t last_bytes = 0;        // of the finest segment at the finest level, in all ranks
  std::uint64_t bytes_before = 0;      // of all other rows
};

RowPlaces place_rows(Ranks& ranks, const RowFiles& files, std::size_t resolutions) {
  std::vector<std::uint64_t> own;
  (void)for_each_stream(resolutions, [&](std::size_t segment, std::size_t level) -> Status {
    own.push_back(files.chunk_bytes(segment, level));
    return {};
  });
  const auto bytes = gather_arrays(ranks, std::span<const std::uint64_t>(own));  // [rank][stream]
  RowPlaces places;
  std::uint64_t at = 0;
  for (std::size_t stream = 0; stream < own.size(); ++stream) {
    places.bytes_before = at;  // in the end, of all streams but the last
    for (std::size_t r = 0; r < ranks.size(); ++r) {
      if (r == ranks.rank()) places.offsets.push_back(at);
      at += bytes[r][stream];
    }
  }
  places.last_bytes = at - places.bytes_before;
  return places;
}

class JointFile {
 public:
  JointFile(Ranks& ranks, SharedOutput output, RangeReduction& reduction, std::size_t resolutions, std::string folder,
            const BuildProgress& progress, JointCells* cells)
      : ranks_(ranks),
        output_(std::move(output)),
        reduction_(reduction),
        resolutions_(resolutions),
        folder_(std::move(folder)),
        progress_(progress),
        cells_(cells) {}

  Result<std::uint64_t> run(const format::Histograms& histograms) {
    progress_("indexing", 0);
    SPLATVOL_TRY_ASSIGN(index, pack_index());
    const RowPlaces places = place_rows(ranks_, reduction_.files(), resolutions_);
    SPLATVOL_TRY_ASSIGN(first_row, begin(places, std::move(index)));
    SPLATVOL_TRY(ranks_.agree(write_rows(places, first_row)));
    SPLATVOL_TRY(add_entries());
    Status finished;
    if (writer_) finished = writer_->finish_unchecked(histograms);
    SPLATVOL_TRY(ranks_.agree(finished ? output_.sync() : finished));
    SPLATVOL_TRY(check());
    SPLATVOL_TRY(ranks_.agree(writer_ ? writer_->commit() : Status{}));
    return writer_ ? writer_->file_bytes() : 0;
  }

 private:
  // Returns the index on rank 0.
  Result<std::optional<format::PackedIndex>> pack_index() {
    const auto make_pages = [&]() -> Result<std::optional<TempFile>> {
      if (!ranks_.is_first()) return std::nullopt;
      SPLATVOL_TRY_ASSIGN(file, TempFile::create(folder_));
      return std::optional(std::move(file));
    };
    SPLATVOL_TRY_ASSIGN(pages, ranks_.agree_on(make_pages()));
    IndexStream index(reduction_.info().cube, resolutions_, attributes(),
                      [&](const format::PackedIndexPage& page) { return pages->append(page.bytes); });
    const auto add = [&](IndexLeaf leaf) -> Status {
      if (cells_) SPLATVOL_TRY(cells_->add_leaf(leaf));
      return index.add(std::move(leaf));
    };
    SPLATVOL_TRY(reduction_.visit_leaves(resolutions_, add));
    const auto finish = [&]() -> Result<std::optional<format::PackedIndex>> {
      if (!pages) return std::nullopt;
      SPLATVOL_TRY_ASSIGN(root, index.finish());
      return format::PackedIndex{IndexStream::shape(resolutions_, attributes()), std::move(root), std::move(*pages)};
    };
    return ranks_.agree_on(finish());
  }

  // Returns the offset of the first row.
  Result<std::uint64_t> begin(const RowPlaces& places, std::optional<format::PackedIndex> index) {
    const auto create = [&]() -> Result<std::unique_ptr<format::VolumeWriter>> {
      if (!index) return nullptr;
      if (cells_) reduction_.info().cells = cells_->info();
      return format::VolumeWriter::create_around(output_.take_file(), places.bytes_before, places.last_bytes,
                                                 std::move(reduction_.info()), std::move(*index), folder_);
    };
    SPLATVOL_TRY_SET(writer_, ranks_.agree_on(create()));
    if (writer_ && cells_) writer_->set_cells(cells_->writer(progress_));
    std::uint64_t first_row = writer_ ? writer_->first_row_offset() : 0;
    ranks_.sum({&first_row, 1});
    return first_row;
  }

  // Writes the rows of this rank, and keeps their entries.
  Status write_rows(const RowPlaces& places, std::uint64_t first_row) {
    std::size_t stream = 0;
    const Status written = for_each_stream(resolutions_, [&](std::size_t segment, std::size_t level) -> Status {
      std::uint64_t at = first_row + places.offsets[stream++];
      BlockSpool& entries = entries_.emplace_back(folder_);
      const double done = static_cast<double>(stream) / static_cast<double>(places.offsets.size());
      return reduction_.files().read(
          segment, level, [&](std::span<const format::ChunkEntry> row, std::span<const std::byte> bytes) -> Status {
            SPLATVOL_TRY(check_interruption());
            progress_("writing", done);
            SPLATVOL_TRY(output_.write_at(at, bytes));
            at += bytes.size();
            return entries.append(std::as_bytes(row));
          });
    });
    return written ? output_.sync() : written;
  }

  // Collective: rank 0 gets the entries of all rows in their order.
  Status add_entries() {
    std::size_t stream = 0;
    return for_each_stream(resolutions_, [&](std::size_t segment, std::size_t level) {
      BlockSpool& entries = entries_[stream++];
      const std::size_t row_entries = columns_of_row(segment, level);
      return ranks_.gather_in_order([&](const Ranks::Emit& emit) { return entries.read(emit); },
                                    [&](std::size_t, std::span<const std::byte> bytes) -> Status {
                                      std::vector<format::ChunkEntry> row(row_entries);
                                      for (; !bytes.empty();
                                           bytes = bytes.subspan(row.size() * sizeof(format::ChunkEntry))) {
                                        std::memcpy(row.data(), bytes.data(), row.size() * sizeof(format::ChunkEntry));
                                        SPLATVOL_TRY(writer_->add_written_row(row));
                                      }
                                      return {};
                                    });
    });
  }

  // Collective: the file is read back, by all ranks, before it gets its name.
  Status check() {
    const auto progress = [&](double fraction) { progress_("checking", fraction); };
    std::shared_ptr<const format::Volume> volume;
    const auto check_own = [&]() -> Result<format::Volume::CheckedValues> {
      SPLATVOL_TRY_SET(volume, open_finished());
      return volume->verify_chunks(ranks_.rank(), ranks_.size(), progress);
    };
    auto own = check_own();
    SPLATVOL_TRY(agree_on_check(status_of(own)));
    for (format::Histogram& histogram : own->histograms) ranks_.sum(histogram);
    ranks_.sum(own->missing);
    return agree_on_check(writer_ ? volume->verify_rest(*own, progress) : Status{});
  }

  Result<std::shared_ptr<const format::Volume>> open_finished() const {
    SPLATVOL_TRY_ASSIGN(source, open_file(output_.path_to_read()));
    return format::Volume::open(std::move(source));
  }

  Status agree_on_check(const Status& own) {
    Status checked = ranks_.agree(own);
    if (checked || checked.error().code == ErrorCode::cancelled) return checked;
    return fail(checked.error().code, "the finished file is not kept, as reading it back finds it wrong: {}",
                checked.error().message);
  }

  // Only the rows of a segment's own resolution have the columns of points.
  std::size_t columns_of_row(std::size_t segment, std::size_t level) const {
    const auto is_in_row = [&](const format::Column& column) {
      return segment == level || column.scope == format::ColumnScope::resolution;
    };
    return static_cast<std::size_t>(std::ranges::count_if(columns_, is_in_row));
  }

  std::size_t attributes() const { return reduction_.info().attributes.size(); }

  Ranks& ranks_;
  SharedOutput output_;
  RangeReduction& reduction_;
  std::size_t resolutions_;
  std::string folder_;
  const BuildProgress& progress_;
  JointCells* cells_;  // null: the file keeps none
  std::vector<format::Column> columns_ = reduction_.info().columns;
  std::vector<BlockSpool> entries_;               // [stream]: of this rank's rows
  std::unique_ptr<format::VolumeWriter> writer_;  // rank 0
};

}  // namespace

Result<std::uint64_t> write_joint_file(Ranks& ranks, SharedOutput output, RangeReduction& reduction,
                                       std::size_t resolutions, const format::Histograms& histograms,
                                       const std::string& folder, const BuildProgress& progress, JointCells* cells) {
  return JointFile(ranks, std::move(output), reduction, resolutions, folder, progress, cells).run(histograms);
}

}  // namespace splatvol
