// What a view wants of a file that is read while frames go on: asked for in the order of need, and held while it is
// wanted.
#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <unordered_map>
#include <utility>
#include <vector>

#include "base/error.h"
#include "format/volume.h"
#include "streamer/cache.h"
#include "streamer/cut.h"
#include "streamer/gather.h"
#include "streamer/loader.h"
#include "streamer/paged_volume.h"
#include "streamer/visibility.h"

namespace splatvol {

/// The parts of a file that are there, and those that are wanted. No call waits for the file but `wait_until`,
/// `pin_coarsest` and the destructor.
///
/// A selection: `begin_selection`, cuts, perhaps `keep_pages`; then `want` for each cut that is to be read, and `ask`.
/// What is wanted does not lose its place in the cache before it is no longer so; neither does what `holds` was asked
/// about, until the next `ask`. Not thread-safe.
class Pager final : public IndexPages, public Residency {
 public:
  /// `bytes_in_flight`: what is being read and decoded may take at once, with the data that comes of it; one chunk more
  /// where that is too little for one. Keeps references to all.
  Pager(PagedVolume& paged, Cache& cache, const Gatherer& gatherer, std::uint64_t bytes_in_flight, unsigned threads);

  /// Reads the root of the index and all chunks of resolution 0, which stay from then on.
  [[nodiscard]] Status pin_coarsest();
  [[nodiscard]] std::uint64_t pinned_bytes() const { return pinned_bytes_; }

  /// Pages that cuts have come by, and references to those that were not there.
  struct Pages {
    std::map<CacheKey, Cache::Pointer> held;
    std::map<CacheKey, IndexPageLoad> missing;
    std::uint64_t index_bytes = 0;   // held
    std::uint64_t packed_bytes = 0;  // of the index, there or not, at least
  };

  /// What is visible from now on; forgets what was wanted.
  void forget(const ValueVisibility& visibility);

  /// Forgets which pages were come by.
  void begin_selection() { pages_ = {}; }
  [[nodiscard]] const Pages& pages() const { return pages_; }
  void keep_pages(Pages pages) { pages_ = std::move(pages); }

  /// The same; those that are missing now are asked for too, when nothing else is.
  void keep_pages_and_ask_ahead(Pages pages);

  /// Pages that are there; null where a page is not, which is then asked for.
  [[nodiscard]] Result<std::shared_ptr<const format::IndexPage>> root() override;
  [[nodiscard]] Result<std::shared_ptr<const format::IndexPage>> linked(const format::IndexPage& page,
                                                                        std::uint32_t node) override;
  [[nodiscard]] bool holds(std::span<const PointRange> ranges) override;

  /// The step of what a view to come may need.
  static constexpr int ahead = -1;

  /// Wants a cut's chunks: those of higher steps before all others, within a step by error. Step 0 is what is needed;
  /// steps above lead there and are left out where all of that is there; for what is `ahead` nothing gives way.
  void want(const Cut& cut, int step);

  /// Asks for what is wanted and not there, as far as there is memory. What was asked for and not begun is asked for
  /// only if it is wanted still.
  void ask();

  /// Whether something was asked for and has not arrived.
  [[nodiscard]] bool is_reading() const { return !in_flight_.empty(); }

  /// Holds nothing but what is wanted.
  void hold_wanted();

  /// What has arrived, by kind.
  struct Arrivals {
    bool pages = false;
    bool chunks = false;

    [[nodiscard]] explicit operator bool() const { return pages || chunks; }
  };
  Arrivals take_in();
  void wait_until(std::chrono::steady_clock::time_point deadline) { loader_.wait_until(deadline); }

  /// What is wanted and was not there at the last `ask`; and of it, what cannot be read.
  struct Missing {
    std::uint64_t chunks = 0;  // as far as their places are known
    std::uint64_t pages = 0;
    std::uint64_t bytes = 0;
    std::uint64_t failed = 0;  // chunks and pages

    [[nodiscard]] bool settled() const { return chunks + pages == failed; }
  };
  [[nodiscard]] const Missing& missing() const { return missing_; }

  /// Packed bytes of all that is needed: chunks of step 0 and pages, there or not, as far as their places are known.
  [[nodiscard]] std::uint64_t needed_bytes() const { return needed_bytes_; }

  /// Errors since the last call; each part that cannot be read has one, once.
  [[nodiscard]] std::vector<Error> take_errors() { return std::exchange(errors_, {}); }

 private:
  enum class State { hidden, ready, missing, unplaced };
  struct Row {
    State state = State::unplaced;
    std::vector<Cache::Pointer> chunks;
  };
  struct Want {
    std::uint32_t resolution;
    std::uint64_t group;
    int step;
    bool needed;
    float error;
  };
  struct Request {
    int step;
    float error;
    LoadRun run;
  };
  [[nodiscard]] Cache::Pointer find_page(const CacheKey& key);
  [[nodiscard]] const format::DirectoryPage* find_directory_page(std::uint64_t row);
  [[nodiscard]] State state_of(std::uint32_t resolution, std::uint64_t group);
  void look_up(std::uint32_t resolution, std::uint64_t group, Row& row);
  [[nodiscard]] std::vector<Request> requests();
  void add_pages(const std::set<std::uint64_t>& directory_pages, std::vector<Request>& requests);
  struct Chunk {
    int step;
    PartLoad part;
  };
  void add_chunks(const Want& want, std::map<CacheKey, Chunk>& chunks, std::set<CacheKey>& needed,
                  std::set<std::uint64_t>& directory_pages);
  void miss(const CacheKey& key, std::uint64_t& parts, std::uint64_t packed_bytes);
  [[nodiscard]] bool can_ask(const CacheKey& key) const { return !in_flight_.contains(key) && !failed_.contains(key); }
  [[nodiscard]] bool submit(LoadRun run, bool may_evict);
  [[nodiscard]] bool reserve(PartLoad& part, bool may_evict);
  void arrive(PartLoad& part, Arrivals& arrivals);

  PagedVolume& paged_;
  Cache& cache_;
  const Gatherer& gatherer_;
  const std::uint64_t most_in_flight_;
  std::optional<ValueVisibility> visibility_;
  std::vector<Cache::Pointer> pinned_;
  std::uint64_t pinned_bytes_ = 0;

  Pages pages_;
  std::map<CacheKey, IndexPageLoad> pages_ahead_;  // that the next view may need
  std::unordered_map<std::uint64_t, Row> rows_;
  std::unordered_map<std::uint64_t, Want> wants_;
  std::map<CacheKey, std::uint64_t> in_flight_;  // bytes of each
  std::uint64_t bytes_in_flight_ = 0;
  std::uint64_t largest_index_page_ = 0;  // in memory, so far
  std::set<CacheKey> failed_;
  std::vector<Error> errors_;
  Missing missing_;
  std::uint64_t needed_bytes_ = 0;
  Loader loader_;  // last: its threads end first
};

}  // namespace splatvol
