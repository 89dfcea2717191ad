#include "builder/distributed/range_reduction.h"

#include <algorithm>
#include <numeric>
#include <utility>

#include "builder/output/byte_streams.h"
#include "builder/pipeline/describe.h"
#include "builder/pipeline/reduce_source.h"
#include "builder/points/batch_cutter.h"
#include "builder/points/material_estimator.h"
#include "builder/reduction/reduction_pipeline.h"

namespace splatvol {
namespace {

// Messages of about this size keep the sender's memory small, and the receiver busy.
constexpr std::size_t message_bytes = std::size_t{1} << 18;

// Most leaves have points and splats at the finest resolutions only: those before stay at home.
void put(ByteWriter& out, const IndexLeaf& leaf) {
  std::uint64_t first = 0;
  while (first < leaf.counts.size() && leaf.counts[first] == 0 && leaf.splats[first].least_depth == 255) ++first;
  out.put(leaf.key);
  out.put(leaf.depth);
  out.put(first);
  out.append(std::as_bytes(std::span(leaf.counts).subspan(first)));
  out.append(std::as_bytes(std::span(leaf.splats).subspan(first)));
  out.append(std::as_bytes(std::span(leaf.summaries)));
}

IndexLeaf get_leaf(ByteReader& in, std::size_t resolutions, std::size_t attributes) {
  IndexLeaf leaf;
  leaf.counts.resize(resolutions);
  leaf.splats.resize(resolutions);
  leaf.summaries.resize(attributes);
  std::uint64_t first = 0;
  in.get(leaf.key);
  in.get(leaf.depth);
  in.get(first);
  in.fill(std::span(leaf.counts).subspan(first));
  in.fill(std::span(leaf.splats).subspan(first));
  in.fill(std::span(leaf.summaries));
  return leaf;
}

// Adds what came late: levels count from the finest resolution, a whole leaf counts from the coarsest.
void include_late(const OpenIndexLeaf& late, IndexLeaf& leaf) {
  const std::size_t last = leaf.counts.size() - 1;
  for (std::size_t level = 0; level < late.counts.size(); ++level) leaf.counts[last - level] += late.counts[level];
  for (std::size_t level = 0; level < late.splats.size(); ++level)
    leaf.splats[last - level].include(late.splats[level]);
}

void put_row(const PendingRow& row, std::vector<std::byte>& bytes) {
  format::append_record(bytes, std::uint64_t{row.segment});
  format::append_record(bytes, std::uint64_t{row.level});
  row.splats->put_into(bytes);
}

std::vector<PendingRow> read_rows(std::span<const std::byte> bytes, std::size_t attributes) {
  std::vector<PendingRow> rows;
  for (ByteReader in(bytes); !in.at_end();) {
    std::uint64_t segment = 0, level = 0;
    in.get(segment);
    in.get(level);
    PendingRow& row = rows.emplace_back(PendingRow{segment, level, std::make_unique<SplatColumns>(attributes), {}});
    (void)in.take(row.splats->append_from(in.rest()));
  }
  return rows;
}

}  // namespace

RangeReduction::Part::Part(ReductionSettings of_part, const format::VolumeInfo& info, const GroupSizes& groups,
                           std::size_t memory, const std::string& folder, SharedRows shared,
                           std::function<Status(const OpenIndexLeaf&)> leaves, std::uint64_t most_open_leaves)
    : settings(std::move(of_part)),
      rows(info, groups, memory, folder, std::move(shared)),
      pass(settings, rows, std::move(leaves), most_open_leaves) {}

RangeReduction::RangeReduction(Ranks& ranks, const BuildOptions& options, const InputSummary& input,
                               const RangePlan& plan, bool estimates, std::string folder, WatchStays stays)
    : ranks_(ranks),
      options_(options),
      input_(input),
      plan_(plan),
      estimates_(estimates),
      folder_(std::move(folder)),
      stays_(std::move(stays)),
      info_(describe_volume(options, input.cube, input.attributes)),
      memory_(plan_memory(options.memory, {.attributes = input.attributes.size(),
                                           .gradients = options.gradients,
                                           .estimates = estimates,
                                           .index_leaf_points = index_leaf_points(options)})),
      packer_(info_, options.exact),
      files_(folder_),
      beyond_(folder_) {}

ReductionSettings RangeReduction::settings() const {
  return {.cube = input_.cube,
          .leaf_points = options_.leaf_points,
          .reduces = true,
          .attributes = input_.attributes,
          .packer = &packer_,
          .points_per_chunk = options_.points_per_chunk.of(0),
          .method = options_.reduction};
}

Status RangeReduction::reduce(const NextPoints& next, std::uint64_t points, const BuildProgress& progress) {
  leaves_.emplace(folder_);
  ReductionSettings of_range = settings();
  of_range.part = {.borders = plan_.borders.keys, .first = 1, .end = plan_.own_levels + 1};
  of_range.finest_before = plan_.before[0];
  if (stays_)
    of_range.stays = [this](std::size_t level, std::uint64_t point) {
      return stays_(level, plan_.points_before + point);
    };
  of_range.beyond = [this](const Member& member) {
    if (kept_) kept_ = beyond_.append(member.bytes());
  };
  range_ = std::make_unique<Part>(
      std::move(of_range), info_, options_.points_per_chunk, memory_.rows, folder_,
      SharedRows{plan_.before, !is_last()},
      [this](const OpenIndexLeaf& leaf) {
        ++leaf_count_;
        return leaves_->append(leaf);
      },
      memory_.most_open_leaves);

  const std::size_t attributes = input_.attributes.size();
  BatchCutter batches(next, attributes, index_leaf_points(options_), memory_.batches, plan_.borders);
  MaterialEstimator estimator(input_.box, input_.cube, options_.gradients);
  const ReductionStages stages{batches, estimates_ ? &estimator : nullptr, range_->pass, range_->rows, packer_, files_};
  const auto done = [&](std::uint64_t count) {
    progress("reducing", static_cast<double>(count) / static_cast<double>(points));
  };
  SPLATVOL_TRY(run_reduction(stages, attributes, done, memory_.most_batches));
  SPLATVOL_TRY(kept_);
  return finish_rows(*range_);
}

Status RangeReduction::finish_rows(Part& part) {
  SPLATVOL_TRY_ASSIGN(rest, part.rows.extract_rest());
  return write_rows(rest, packer_, files_);
}

Status RangeReduction::join_shared_rows() {
  Status joined;
  if (has_range()) {
    const Bytes received = ranks_.is_first() ? Bytes{} : ranks_.receive(ranks_.rank() - 1);
    Bytes passed_on;
    joined = join_rows(received, passed_on);
    if (!is_last()) ranks_.send(ranks_.rank() + 1, passed_on);
  }
  return ranks_.agree(joined);
}

// Completes the rows that began in ranges before this one. Those that do not end here are passed on.
Status RangeReduction::join_rows(std::span<const std::byte> received, std::vector<std::byte>& passed_on) {
  std::vector<PendingRow> begun = read_rows(received, input_.attributes.size());
  RowCollector::Ends ends = range_->rows.extract_ends();
  for (const PendingRow& first : ends.first) {
    const auto row = std::ranges::find_if(
        begun, [&](const PendingRow& other) { return other.segment == first.segment && other.level == first.level; });
    if (row == begun.end() || row->splats->size() != first.absent)
      return fail(ErrorCode::invalid_argument, "ranks: a row across a border does not fit");
    row->splats->append(*first.splats);
  }
  for (PendingRow& row : begun) {
    const bool complete = row.splats->size() == options_.points_per_chunk.of(row.segment);
    if (complete || is_last())
      SPLATVOL_TRY(write_joined(std::move(row)));
    else
      put_row(row, passed_on);
  }
  for (const PendingRow& row : ends.last) put_row(row, passed_on);
  return {};
}

Status RangeReduction::write_joined(PendingRow row) {
  SPLATVOL_TRY(packer_.pack(row));
  return files_.write_first(row);
}

Status RangeReduction::reduce_coarse_levels() {
  first_leaves_ = gather_values(ranks_, leaf_count_);
  std::exclusive_scan(first_leaves_.begin(), first_leaves_.end(), first_leaves_.begin(), std::uint64_t{0});
  first_points_ = gather_values(ranks_, plan_.points_before);
  if (ranks_.is_first()) {
    ReductionSettings of_coarse = settings();
    of_coarse.stays = stays_;
    of_coarse.part.first = plan_.own_levels + 1;
    coarse_ = std::make_unique<Part>(
        std::move(of_coarse), info_, options_.points_per_chunk, memory_.rows, folder_, SharedRows{},
        [](const OpenIndexLeaf&) { return Status{}; }, memory_.most_open_leaves);
  }
  SPLATVOL_TRY(ranks_.gather_in_order(
      [&](const Ranks::Emit& emit) { return beyond_.read(emit); },
      [&](std::size_t rank, std::span<const std::byte> bytes) { return add_members(rank, bytes); }));
  Status finished;
  if (coarse_) {
    finished = coarse_->pass.finish();
    if (finished) finished = finish_rows(*coarse_);
  }
  return ranks_.agree(finished);
}

Status RangeReduction::add_members(std::size_t rank, std::span<const std::byte> bytes) {
  Members one(input_.attributes.size(), coarse_->settings.part.first + 1);
  Member& member = one.add();
  for (ByteReader in(bytes); !in.at_end();) {
    in.fill(member.bytes());
    member.leaf += first_leaves_[rank];
    member.number += first_points_[rank];
    coarse_->pass.add_coarse(member);
  }
  std::vector<PendingRow> rows;
  SPLATVOL_TRY(coarse_->rows.extract_complete(rows));
  return write_rows(rows, packer_, files_);
}

std::vector<std::uint64_t> RangeReduction::counts() {
  std::vector<std::uint64_t> counts = plan_.counts;
  const std::vector<std::uint64_t> coarse = coarse_ ? coarse_->pass.counts() : std::vector<std::uint64_t>();
  ByteWriter out;
  out.put(coarse);
  const Bytes bytes = ranks_.broadcast(out.bytes());
  std::vector<std::uint64_t> of_first;
  ByteReader(bytes).get(of_first);
  counts.insert(counts.end(), of_first.begin(), of_first.end());
  return counts;
}

StoredSummary RangeReduction::stored() {
  const StoredSummary own = packer_.summary();
  ByteWriter out;
  out.put(own.position_error);
  out.put(own.values);
  StoredSummary all;
  all.values.resize(own.values.size());
  for (const Bytes& bytes : ranks_.gather_all(out.bytes())) {
    StoredSummary more;
    ByteReader in(bytes);
    in.get(more.position_error);
    in.get(more.values);
    all.include(more);
  }
  return all;
}

Status RangeReduction::visit_leaves(std::size_t resolutions, const std::function<Status(IndexLeaf)>& visit) {
  const auto produce = [&](const Ranks::Emit& emit) -> Status {
    if (!leaves_) return {};
    ByteWriter out;
    const auto send = [&](const IndexLeaf& leaf) -> Status {
      put(out, leaf);
      if (out.bytes().size() < message_bytes) return {};
      SPLATVOL_TRY(emit(out.bytes()));
      out.clear();
      return {};
    };
    SPLATVOL_TRY(leaves_->read(resolutions, range_->pass.late_leaves(), send));
    return emit(out.bytes());
  };
  std::uint64_t number = 0;
  return ranks_.gather_in_order(produce, [&](std::size_t, std::span<const std::byte> bytes) -> Status {
    const auto& late = coarse_->pass.late_leaves();
    for (ByteReader in(bytes); !in.at_end(); ++number) {
      IndexLeaf leaf = get_leaf(in, resolutions, input_.attributes.size());
      if (const auto more = late.find(number); more != late.end()) include_late(more->second, leaf);
      SPLATVOL_TRY(visit(std::move(leaf)));
    }
    return {};
  });
}

}  // namespace splatvol
