#include "builder/distributed/joint_file.h"

#include <cstring>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "base/interruption.h"
#include "builder/distributed/block_spool.h"
#include "builder/output/index_stream.h"
#include "format/volume.h"
#include "format/volume_writer.h"

namespace splatvol {
namespace {

// Calls visit(segment, level) for all rows of a file in their order.
template <class Visit>
Status for_each_stream(std::size_t resolutions, const Visit& visit) {
  for (std::size_t level = resolutions; level-- > 0;)
    for (std::size_t segment = resolutions; segment-- > level;) SPLATVOL_TRY(visit(segment, level));
  return {};
}

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
  std::vector<std::vector<std::uint64_t>> bytes;  // [rank][stream]
  for (const Bytes& of_rank : ranks.gather_all(std::as_bytes(std::span(own)))) {
    bytes.emplace_back(own.size());
    std::memcpy(bytes.back().data(), of_rank.data(), of_rank.size());
  }
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
            const BuildProgress& progress)
      : ranks_(ranks),
        output_(std::move(output)),
        reduction_(reduction),
        resolutions_(resolutions),
        folder_(std::move(folder)),
        progress_(progress) {}

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
    std::optional<TempFile> pages;
    std::optional<IndexStream> index;
    Status made;
    if (ranks_.is_first()) {
      auto file = TempFile::create(folder_);
      if (!file) made = tl::unexpected<Error>(file.error());
      if (file) pages.emplace(std::move(*file));
      index.emplace(reduction_.info().cube, resolutions_, attributes(),
                    [&](const format::PackedIndexPage& page) { return pages->append(page.bytes); });
    }
    SPLATVOL_TRY(ranks_.agree(made));
    SPLATVOL_TRY(reduction_.visit_leaves(resolutions_, [&](IndexLeaf leaf) { return index->add(std::move(leaf)); }));
    std::optional<format::PackedIndex> packed;
    Status finished;
    if (index) {
      auto root = index->finish();
      if (root) packed = {IndexStream::shape(resolutions_, attributes()), std::move(*root), std::move(*pages)};
      if (!root) finished = tl::unexpected<Error>(root.error());
    }
    SPLATVOL_TRY(ranks_.agree(finished));
    return packed;
  }

  // Returns the offset of the first row.
  Result<std::uint64_t> begin(const RowPlaces& places, std::optional<format::PackedIndex> index) {
    Status begun;
    std::uint64_t first_row = 0;
    if (index) {
      auto writer = format::VolumeWriter::create_around(output_.take_file(), places.bytes_before, places.last_bytes,
                                                        std::move(reduction_.info()), std::move(*index), folder_);
      if (writer) first_row = (*writer)->first_row_offset();
      if (writer) writer_ = std::move(*writer);
      if (!writer) begun = tl::unexpected<Error>(writer.error());
    }
    SPLATVOL_TRY(ranks_.agree(begun));
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
    auto volume = open_finished();
    Result<format::Volume::CheckedValues> own =
        volume ? (*volume)->verify_chunks(ranks_.rank(), ranks_.size(), progress)
               : Result<format::Volume::CheckedValues>(tl::unexpected<Error>(volume.error()));
    SPLATVOL_TRY(agree_on_check(own ? Status{} : Status(tl::unexpected<Error>(own.error()))));
    for (format::Histogram& histogram : own->histograms) ranks_.sum(histogram);
    ranks_.sum(own->missing);
    return agree_on_check(writer_ ? (*volume)->verify_rest(std::move(*own), progress) : Status{});
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
  std::vector<format::Column> columns_ = reduction_.info().columns;
  std::vector<BlockSpool> entries_;               // [stream]: of this rank's rows
  std::unique_ptr<format::VolumeWriter> writer_;  // rank 0
};

}  // namespace

Result<std::uint64_t> write_joint_file(Ranks& ranks, SharedOutput output, RangeReduction& reduction,
                                       std::size_t resolutions, const format::Histograms& histograms,
                                       const std::string& folder, const BuildProgress& progress) {
  return JointFile(ranks, std::move(output), reduction, resolutions, folder, progress).run(histograms);
}

}  // namespace splatvol
