#include "builder/distributed/joint_build.h"

#include <algorithm>
#include <array>
#include <numeric>
#include <optional>
#include <utility>

#include "base/interruption.h"
#include "builder/distributed/joint_cells.h"
#include "builder/distributed/joint_file.h"
#include "builder/distributed/piece_turns.h"
#include "builder/distributed/range_plan.h"
#include "builder/distributed/range_reduction.h"
#include "builder/distributed/record_exchange.h"
#include "builder/distributed/shared_output.h"
#include "builder/output/byte_streams.h"
#include "builder/pipeline/census_lines.h"
#include "builder/pipeline/connect.h"
#include "builder/pipeline/reduce_source.h"
#include "builder/pipeline/store_cells.h"
#include "format/volume_info.h"

namespace splatvol {
namespace {

// Copies of a vertex that pieces share, at most: records are counted before they are merged.
constexpr std::uint64_t usual_copies = 32;

class JointBuild {
 public:
  JointBuild(Ranks& ranks, Source& source, const std::string& output, const BuildOptions& options,
             const BuildProgress& progress, JointCells* cells)
      : ranks_(ranks),
        source_(source),
        output_(output),
        options_(options),
        progress_(progress),
        cells_(cells),
        folder_(temp_folder_of(output, options)),
        memory_(options.memory / 2),
        layout_(PointStream::layout_of(source, uses_cells(options), options.gradients)
                    .with_tags(keeps_cells_of_pieces(source, options))),
        pieces_(ranks, source, layout_, {memory_, folder_}, watch_piece()) {
    if (cells_) pieces_.reader().number_pieces(cells_->first_piece());
  }

  Result<JointReport> run() {
    SPLATVOL_TRY_ASSIGN(file, SharedOutput::create(ranks_, output_));
    SPLATVOL_TRY(read());
    SPLATVOL_TRY(share_points());
    SPLATVOL_TRY_ASSIGN(plan, make_plan());
    if (!plan) SPLATVOL_TRY(give_all_to_first());
    SPLATVOL_TRY_ASSIGN(corners, share_corners());
    JointReport report;
    report.ranks = ranks_.size();
    report.ranges = begins_.size() + 1;
    report.owned = owned_;
    SPLATVOL_TRY_SET(report.build, plan ? build_in_ranges(std::move(file), std::move(corners), *plan)
                                        : build_on_first(std::move(file), std::move(corners)));
    std::array<std::uint64_t, 1> sent = {ranks_.bytes_sent()};
    ranks_.sum(sent);
    report.sent_bytes = sent[0];
    report.record_bytes = std::accumulate(owned_.begin(), owned_.end(), std::uint64_t{0});
    return report;
  }

 private:
  [[nodiscard]] WatchPiece watch_piece() const {
    if (!layout_.has_tags()) return {};
    return [this](const Piece& piece) -> Status {
      if (piece.cells && ranks_.size() > 1)
        return fail(ErrorCode::unsupported,
                    "several processes cannot keep cells of their own in the file: start one, or add --drop-cells");
      return cells_->add(piece);
    };
  }
  [[nodiscard]] bool has_range() const { return ranks_.rank() <= begins_.size(); }
  [[nodiscard]] std::uint64_t round_memory() const { return memory_ / 16; }
  [[nodiscard]] bool estimates() const { return !is_joined_by_cells(summary_); }

  [[nodiscard]] std::uint64_t records() const { return pieces_.records(); }

  // Most points in an index leaf or an estimate node.
  [[nodiscard]] std::uint64_t node_points() const {
    return std::max<std::uint64_t>(estimates() ? estimate_node_points : 0, index_leaf_points(options_));
  }

  Status read() {
    std::optional<Box> bounds;
    // Without material, the box of the points is known as soon as they have been read.
    if (layout_.has_material()) SPLATVOL_TRY_SET(bounds, ranks_.agree_on(source_.bounds()));
    SPLATVOL_TRY(pieces_.read([&](double fraction) { progress_("reading", fraction); }));
    leaves_out_ = !bounds;
    SPLATVOL_TRY_SET(cube_, bounding_cube(bounds.value_or(pieces_.reader().box())));
    summary_ = pieces_.reader().summary(joined_attributes(options_));
    if (estimates() && joins_by_boxes()) cells_ = nullptr;
    return {};
  }

  [[nodiscard]] bool joins_by_boxes() const {
    return connectivity_of_points(options_, records()) == Connectivity::boxes;
  }

  // Whether what comes after the sort can be done range by range.
  [[nodiscard]] bool reduces_in_ranges() const {
    const bool refused =
        options_.connectivity == Connectivity::automatic && !describe_no_volume(summary_.cells).empty();
    return (is_joined_by_cells(summary_) || (joins_by_boxes() && !refused)) && options_.reduction == Reduction::octree;
  }

  // Rank 0 has the samples, and chooses for all.
  Status choose_begins() {
    if (!reduces_in_ranges()) return {};
    SPLATVOL_TRY_ASSIGN(samples, pieces_.sample_keys(cube_));
    // Twice as many as needed, and some: fewer points than needed then give so many samples with a probability of
    // less than 1e-30.
    const std::uint64_t needed = (node_points() + 1) * (estimates() ? 1 : usual_copies);
    const double least = 2 * samples.probability * static_cast<double>(needed) + 64;
    begins_ = choose_ranges(samples.keys, ranks_.size(), static_cast<std::size_t>(least));
    ByteWriter chosen;
    chosen.put(begins_);
    const Bytes bytes = ranks_.broadcast(chosen.bytes());
    ByteReader(bytes).get(begins_);
    return {};
  }

  // Returns a sorter of points on the ranks that need one.
  [[nodiscard]] Result<std::optional<ExternalSorter>> make_sorter(bool is_needed, bool rewinds) const {
    if (!is_needed) return std::nullopt;
    SPLATVOL_TRY_ASSIGN(sorter,
                        PointStream::sort_of_points(layout_, cube_, memory_ / 2, memory_ / 4, folder_, rewinds));
    return std::optional(std::move(sorter));
  }

  // Sends all records to the ranks that sort them.
  Status share_points() {
    progress_("sorting", 0);
    SPLATVOL_TRY(choose_begins());
    SPLATVOL_TRY_SET(sorter_, ranks_.agree_on(make_sorter(has_range(), true)));
    const std::uint64_t share = records() / (begins_.size() + 1);
    SPLATVOL_TRY(ranks_.agree(sorter_ ? PointStream::check_room(folder_, share, *sorter_) : Status{}));
    SPLATVOL_TRY(exchange_pieces(ranks_, pieces_, layout_, cube_, begins_, leaves_out_, round_memory(),
                                 [&](std::span<const std::byte> records) { return sorter_->add(records); }));
    SPLATVOL_TRY(ranks_.agree(sorter_ ? sorter_->finish() : Status{}));
    pieces_.add_left_out();
    summary_ = pieces_.reader().summary(joined_attributes(options_));
    summary_.cube = cube_;
    summary_.bytes_to_read += memory_ / 16 + std::min<std::uint64_t>(memory_, summary_.census.read * layout_.bytes());
    owned_ = gather_values(ranks_, sorter_ ? sorter_->count() * layout_.bytes() : std::uint64_t{0});
    return {};
  }

  Result<std::optional<RangePlan>> make_plan() {
    if (begins_.empty()) return std::nullopt;
    progress_("counting", 0);
    if (sorter_) points_.emplace(layout_, summary_, std::move(*sorter_), std::nullopt);
    return plan_ranges(ranks_, begins_, points_ ? &*points_ : nullptr, options_, index_leaf_points(options_),
                       node_points());
  }

  // If the points cannot be reduced in ranges after all, rank 0 sorts them again.
  Status give_all_to_first() {
    if (begins_.empty()) return {};
    SPLATVOL_TRY_ASSIGN(all, ranks_.agree_on(make_sorter(ranks_.is_first(), false)));
    if (points_) sorter_.emplace(points_->take_sort());
    const auto next = [&]() -> Result<OwnedRecords> {
      if (!sorter_) return OwnedRecords{};
      SPLATVOL_TRY_ASSIGN(sorted, sorter_->next());
      return OwnedRecords{sorted.records, std::vector<std::uint32_t>(sorted.keys.size(), 0)};
    };
    SPLATVOL_TRY(exchange_records(ranks_, layout_.bytes(), round_memory(), next,
                                  [&](std::span<const std::byte> records) { return all->add(records); }));
    points_.reset();
    sorter_ = std::move(all);
    begins_.clear();
    return ranks_.agree(sorter_ ? sorter_->finish() : Status{});
  }

  // Finds the outer faces of the whole mesh, and sends their corners to the ranks that have the points. A face goes to
  // the rank that its key names: there it meets the same face of a neighbouring piece.
  Result<std::optional<BoundaryCorners>> share_corners() {
    SPLATVOL_TRY_ASSIGN(own, ranks_.agree_on(pieces_.faces().take_faces()));
    std::array<std::uint64_t, 2> any = {own ? 1u : 0u, pieces_.faces().of_cells() ? 1u : 0u};
    ranks_.largest(any);
    if (any[0] == 0) return std::nullopt;
    BlockSpool found(folder_);
    SPLATVOL_TRY(match_faces(own, any[1] != 0, found));
    return sort_corners(found);
  }

  Status match_faces(std::optional<ExternalSorter>& own, bool of_cells, BlockSpool& found) {
    SPLATVOL_TRY_ASSIGN(faces, ranks_.agree_on(pieces_.faces().sort_of_faces()));
    const auto next = [&]() -> Result<OwnedRecords> {
      if (!own) return OwnedRecords{};
      SPLATVOL_TRY_ASSIGN(sorted, own->next());
      OwnedRecords owned{sorted.records, {}};
      for (const MortonKey& key : sorted.keys)
        owned.owners.push_back(static_cast<std::uint32_t>(key.high % ranks_.size()));
      return owned;
    };
    SPLATVOL_TRY(exchange_records(ranks_, PieceFaces::face_bytes(), round_memory(), next,
                                  [&](std::span<const std::byte> records) { return faces.add(records); }));
    own.reset();
    Status matched = faces.finish();
    if (matched)
      matched = PieceFaces::find_corners(faces, of_cells,
                                         [&](std::span<const std::byte> areas) { return found.append(areas); });
    return ranks_.agree(matched);
  }

  Result<std::optional<BoundaryCorners>> sort_corners(BlockSpool& found) {
    SPLATVOL_TRY_ASSIGN(corners, ranks_.agree_on(pieces_.faces().sort_of_corners(cube_)));
    const auto next = [&]() -> Result<OwnedRecords> {
      SPLATVOL_TRY_ASSIGN(bytes, found.next());
      OwnedRecords owned{bytes, {}};
      for (std::size_t i = 0; i < bytes.size() / sizeof(CornerArea); ++i) {
        const MortonKey key = morton_key(record_at<CornerArea>(bytes, i).corner.position, cube_);
        owned.owners.push_back(static_cast<std::uint32_t>(range_of(begins_, key)));
      }
      return owned;
    };
    SPLATVOL_TRY(exchange_records(ranks_, sizeof(CornerArea), round_memory(), next,
                                  [&](std::span<const std::byte> records) { return corners.add(records); }));
    SPLATVOL_TRY(ranks_.agree(corners.finish()));
    return BoundaryCorners(layout_, std::move(corners));
  }

  Result<BuildReport> build_on_first(SharedOutput file, std::optional<BoundaryCorners> corners) {
    if (cells_) SPLATVOL_TRY(cells_->give_to_first());
    if (!ranks_.is_first()) return ranks_.agree_on(Result<BuildReport>());
    PointStream points(layout_, summary_, std::move(*sorter_), std::move(corners));
    MeshCells* cells = cells_ ? &cells_->cells() : nullptr;
    if (cells && layout_.has_tags())
      points.watch_ranks(0, [cells](PointTag tag, std::uint64_t rank) { return cells->add_rank(tag, rank); });
    return ranks_.agree_on(
        build_from_points(std::move(points), file.take_file(), folder_, options_, progress_, nullptr, cells));
  }

  Result<BuildReport> build_in_ranges(SharedOutput file, std::optional<BoundaryCorners> corners,
                                      const RangePlan& plan) {
    if (points_ && corners) points_->set_corners(std::move(*corners));
    WatchStays stays;
    if (cells_)
      stays = [cells = cells_](std::size_t level, std::uint64_t rank) { return cells->add_stay(level, rank); };
    if (cells_ && points_)
      points_->watch_ranks(plan.points_before,
                           [cells = cells_](PointTag tag, std::uint64_t rank) { return cells->add_rank(tag, rank); });
    RangeReduction reduction(ranks_, options_, summary_, plan, estimates(), folder_, std::move(stays));
    Status reduced;
    if (points_) {
      const auto next = [this](PointBatch& batch) { return points_->next(batch); };
      reduced = reduction.reduce(next, points_->count(), progress_);
    }
    SPLATVOL_TRY(ranks_.agree(reduced));
    SPLATVOL_TRY(reduction.join_shared_rows());
    SPLATVOL_TRY(reduction.reduce_coarse_levels());
    sum_census();
    points_.reset();
    if (cells_) {
      progress_("sorting cells", 0);
      SPLATVOL_TRY(cells_->sort());
    }

    const std::vector<std::uint64_t> counts = reduction.counts();
    const StoredSummary stored = reduction.stored();
    BuildReport report =
        complete_description(options_, summary_,
                             {.connectivity = estimates() ? Connectivity::boxes : Connectivity::mesh,
                              .least_memory = std::max(reduction.least_memory(), summary_.bytes_to_read),
                              .counts = counts,
                              .stored = stored},
                             reduction.info());
    if (options_.strict) SPLATVOL_TRY(check_unchanged(report));
    SPLATVOL_TRY_SET(report.file_bytes, write_joint_file(ranks_, std::move(file), reduction, counts.size(),
                                                         stored.histograms(), folder_, progress_, cells_));
    if (cells_) report.kept_cells = cells_->report();
    return report;
  }

  void sum_census() {
    const PointCensus own = points_ ? points_->summary().census : PointCensus{};
    std::array<std::uint64_t, 3> counts = {own.merged, own.unlike, own.coincident};
    ranks_.sum(counts);
    summary_.census.merged = counts[0];
    summary_.census.unlike = counts[1];
    summary_.census.coincident = counts[2];
  }

  Ranks& ranks_;
  Source& source_;
  const std::string& output_;
  const BuildOptions& options_;
  const BuildProgress& progress_;
  JointCells* cells_;  // null: there are none to keep
  std::string folder_;
  std::size_t memory_;  // for the points
  PointRecords layout_;
  PieceTurns pieces_;
  bool leaves_out_ = true;
  Cube cube_;
  InputSummary summary_;
  RangeBegins begins_;
  std::vector<std::uint64_t> owned_;      // JointReport::owned
  std::optional<ExternalSorter> sorter_;  // the records of this rank's range
  std::optional<PointStream> points_;     // made of these, if there are several ranges
};

}  // namespace

Result<JointReport> build_volume_together(Ranks& ranks, const std::function<Result<std::unique_ptr<Source>>()>& open,
                                          std::unique_ptr<Source>& source, const std::string& output,
                                          const BuildOptions& options, const BuildProgress& progress) {
  const Interruptible heed(ranks.stop());
  const auto open_checked = [&]() -> Result<std::unique_ptr<Source>> {
    SPLATVOL_TRY(check_reduction(options));
    SPLATVOL_TRY_ASSIGN(opened, open());
    SPLATVOL_TRY(check_units(*opened, options));
    return opened;
  };
  SPLATVOL_TRY_SET(source, ranks.agree_on(open_checked()));
  SPLATVOL_TRY_ASSIGN(cells,
                      ranks.agree_on(JointCells::create(ranks, *source, options, temp_folder_of(output, options))));
  return JointBuild(ranks, *source, output, options, progress, cells.get()).run();
}

}  // namespace splatvol
