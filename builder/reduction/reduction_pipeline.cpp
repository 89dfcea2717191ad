#include "builder/reduction/reduction_pipeline.h"

#include <tbb/parallel_pipeline.h>
#include <tbb/spin_mutex.h>

#include <atomic>
#include <memory>
#include <vector>

#include "base/interruption.h"

namespace splatvol {
namespace {

// A batch on its way through the stages.
struct Item {
  PointBatch batch;
  ReducedBatch reduced;
  std::vector<PendingRow> rows;
};

// Items whose memory is used again. Thread-safe.
class ItemPool {
 public:
  ItemPool(std::size_t attributes, std::size_t count) {
    for (std::size_t i = 0; i < count; ++i)
      free_.push_back(std::make_unique<Item>(Item{{}, ReducedBatch(attributes), {}}));
  }

  // The item that was released last: its memory is still in a cache.
  Item* acquire() {
    const tbb::spin_mutex::scoped_lock lock(mutex_);
    Item* item = free_.back().release();
    free_.pop_back();
    return item;
  }
  void release(Item* item) {
    const tbb::spin_mutex::scoped_lock lock(mutex_);
    free_.emplace_back(item);
  }

 private:
  tbb::spin_mutex mutex_;
  std::vector<std::unique_ptr<Item>> free_;
};

class ReductionPipeline {
 public:
  ReductionPipeline(const ReductionStages& stages, std::size_t attributes,
                    const std::function<void(std::uint64_t)>& progress, std::size_t most_batches)
      : stages_(stages), progress_(progress), most_batches_(most_batches), items_(attributes, most_batches) {}

  Status run() {
    constexpr auto in_order = tbb::filter_mode::serial_in_order, parallel = tbb::filter_mode::parallel;
    tbb::parallel_pipeline(
        most_batches_,
        tbb::make_filter<void, Item*>(in_order, [&](tbb::flow_control& control) { return cut(control); }) &
            tbb::make_filter<Item*, Item*>(parallel, [&](Item* item) { return reduce(item); }) &
            tbb::make_filter<Item*, Item*>(in_order, [&](Item* item) { return add(item); }) &
            tbb::make_filter<Item*, Item*>(parallel, [&](Item* item) { return pack(item); }) &
            tbb::make_filter<Item*, void>(in_order, [&](Item* item) { write(item); }));
    SPLATVOL_TRY(cut_);
    SPLATVOL_TRY(added_);
    SPLATVOL_TRY(packed_);
    SPLATVOL_TRY(written_);
    return stages_.pass.finish();
  }

 private:
  Item* cut(tbb::flow_control& control) {
    Item* item = items_.acquire();
    const auto more = stages_.batches.next(item->batch);
    if (!more) cut_ = tl::unexpected(more.error());
    if (stop_.stop_requested()) cut_ = fail(ErrorCode::cancelled, "cancelled");
    if (cut_ && *more && !failed_) {
      stages_.pass.prepare(item->batch, item->reduced);
      return item;
    }
    items_.release(item);
    control.stop();
    return nullptr;
  }

  Item* reduce(Item* item) {
    if (stages_.estimator) stages_.estimator->estimate(item->batch);
    stages_.pass.reduce(item->batch, item->reduced);
    return item;
  }

  Item* add(Item* item) {
    if (failed_) return item;
    const PointBatch& batch = item->batch;
    added_ = stages_.pass.add(batch, item->reduced);
    if (added_) added_ = stages_.rows.extract_complete(item->rows);
    if (!added_) failed_ = true;
    progress_(batch.first + batch.size());
    return item;
  }

  Item* pack(Item* item) {
    for (auto row = item->rows.begin(); row != item->rows.end() && !failed_; ++row) {
      const Status packed = stages_.packer.pack(*row);
      if (!packed) fail_packing(packed);
    }
    return item;
  }

  // Several threads pack.
  void fail_packing(const Status& status) {
    const tbb::spin_mutex::scoped_lock lock(packing_);
    if (packed_) packed_ = status;
    failed_ = true;
  }

  void write(Item* item) {
    for (auto row = item->rows.begin(); row != item->rows.end() && !failed_; ++row) {
      written_ = stages_.files.write(*row);
      if (!written_) failed_ = true;
      if (!recycles_) row->splats.reset();
    }
    items_.release(item);
  }

  const ReductionStages& stages_;
  const std::function<void(std::uint64_t)>& progress_;
  std::size_t most_batches_;
  const std::stop_token stop_ = stop_of_thread();  // of the caller: any thread may cut
  ItemPool items_;
  const bool recycles_ = stages_.rows.recycles();
  Status cut_, added_, packed_, written_;
  tbb::spin_mutex packing_;
  std::atomic<bool> failed_ = false;
};

}  // namespace

Status run_reduction(const ReductionStages& stages, std::size_t attributes,
                     const std::function<void(std::uint64_t points)>& progress, std::size_t most_batches) {
  return ReductionPipeline(stages, attributes, progress, most_batches).run();
}

}  // namespace splatvol
