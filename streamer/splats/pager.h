// Reads the parts of a file that views want while frames are drawn: those needed most first. Holds them while they are
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
#include "streamer/splats/cut.h"
#include "streamer/splats/paged_volume.h"
#include "streamer/splats/row_reader.h"
#include "streamer/splats/visibility.h"
#include "streamer/store/loader.h"
#include "streamer/store/parts.h"

namespace splatvol {

/// The parts of a file that are there, and those that are wanted. Only `wait_until`, `pin_coarsest` and the destructor
/// wait for the file.
///
/// To select parts: call `begin_selection`, choose cuts, perhaps call `keep_pages`; then call `want` for each cut that
/// should be read, and `ask`. Parts are held while they are wanted. So are the parts that `holds` was asked
/// about until the next `ask`. Not thread-safe.
class Pager final : public IndexPages, public Residency {
 public:
  /// `bytes_in_flight`: most bytes for parts that are being read and decoded, with their data; if this is too little
  /// for one part, one is read at a time. Keeps references to its arguments.
  Pager(PagedVolume& paged, RowReader& reader, std::uint64_t bytes_in_flight, unsigned threads,
        std::function<void()> on_data);

  /// Reads the root of the index and all rows of resolution 0, with their directory pages. Holds them from then on.
  [[nodiscard]] Status pin_coarsest();

  /// Pages that the choice of cuts has used, and references to those that were not there.
  struct Pages {
    std::map<PartKey, PartPointer> held;
    std::map<PartKey, IndexPageLoad> missing;
    std::uint64_t index_bytes = 0;   // held
    std::uint64_t packed_bytes = 0;  // of index pages, there or not: a lower bound
  };

  /// Sets which values are visible from now on. Forgets everything that was wanted, and for which parts memory did not
  /// suffice.
  void forget(const ValueVisibility& visibility);

  /// Forgets which pages were used.
  void begin_selection() { pages_ = {}; }
  [[nodiscard]] const Pages& pages() const { return pages_; }
  void keep_pages(Pages pages) { pages_ = std::move(pages); }

  /// As keep_pages. `ask` will also ask for the pages that are missing now, when everything else has been asked for.
  void keep_pages_and_ask_ahead(Pages pages);

  /// Return pages that are there, else null; a missing page is then asked for.
  [[nodiscard]] Result<std::shared_ptr<const format::IndexPage>> root() override;
  [[nodiscard]] Result<std::shared_ptr<const format::IndexPage>> linked(const format::IndexPage& page,
                                                                        std::uint32_t node) override;
  [[nodiscard]] bool holds(std::span<const PointRange> ranges) override;

  /// The stage of rows that the next view may need.
  static constexpr int ahead = -1;

  /// Wants the rows of a cut. Higher stages are read before lower ones; within a stage, larger errors first. Stage 0
  /// is the picture that is needed. Higher stages are coarser pictures on the way: they are skipped once all of stage 0
  /// is there. No part is dropped for rows of stage `ahead`.
  void want(const Cut& cut, int stage);

  /// Asks for the parts that are wanted and not there, while memory suffices. Withdraws earlier requests that were not
  /// begun, unless the parts are still wanted. After 1000 parts that could not be read, asks for none: all that are
  /// missing count as failed. `is_final`: no memory becomes free before `forget`; a part for which memory does not
  /// suffice, while no other one is being read, then counts as failed until `forget`.
  void ask(bool is_final);

  /// Whether a part was asked for and has not arrived.
  [[nodiscard]] bool is_reading() const { return !in_flight_.empty(); }

  /// Lets go of all parts that are not wanted.
  void hold_wanted();

  /// Which kinds of parts have arrived.
  struct Arrivals {
    bool pages = false;
    bool rows = false;

    [[nodiscard]] explicit operator bool() const { return pages || rows; }
  };
  /// Takes over the parts that have been read, and notes those that failed.
  Arrivals accept_arrivals();
  void wait_until(std::chrono::steady_clock::time_point deadline) { loader_.wait_until(deadline); }

  /// The needed parts that were not there at the last `ask`.
  struct Missing {
    std::uint64_t rows = 0;  // shapes or values of rows, whose locations are known
    std::uint64_t pages = 0;
    std::uint64_t bytes = 0;   // packed
    std::uint64_t failed = 0;  // of these rows and pages, those that cannot be read or held

    [[nodiscard]] bool settled() const { return rows + pages == failed; }
  };
  [[nodiscard]] const Missing& missing() const { return missing_; }

  /// Returns the packed bytes of all needed parts, there or not: pages, and chunks of stage 0 whose locations are
  /// known.
  [[nodiscard]] std::uint64_t needed_bytes() const { return needed_bytes_; }

  /// Moves out the errors since the last call: one for each part that cannot be read.
  [[nodiscard]] std::vector<Error> extract_errors() { return std::exchange(errors_, {}); }

 private:
  enum class State { hidden, ready, missing, unlocated };
  struct Row {
    State state = State::unlocated;
    HeldRow held;
  };
  struct Want {
    RowName row;
    int stage;
    bool needed;
    float error;
  };
  struct Request {
    int stage;
    float error;
    LoadRun run;
  };
  [[nodiscard]] const PartRoom& room() const { return paged_.room(); }
  [[nodiscard]] Status pin_rows(std::uint64_t groups);
  [[nodiscard]] Status pin_directory_pages(std::uint64_t groups);
  [[nodiscard]] Status pin_root();
  [[nodiscard]] PartPointer find_page(const PartKey& key);
  [[nodiscard]] const format::DirectoryPage* find_directory_page(const RowReader::ChunkName& chunk);
  [[nodiscard]] State state_of(const RowName& name);
  void look_up(const RowName& name, Row& row);
  [[nodiscard]] std::vector<Request> requests();
  void add_pages(const std::set<std::uint64_t>& directory_pages, std::vector<PartLoad>& pages);
  [[nodiscard]] std::uint64_t most_run_bytes() const;
  struct StagedPart {
    int stage;
    PartLoad part;
  };
  // What `requests` collects.
  struct Collected {
    std::map<PartKey, StagedPart> parts;
    std::set<PartKey> needed;
    std::set<std::pair<std::uint64_t, int>> needed_chunks, missing_chunks;  // row and column
    std::set<std::uint64_t> directory_pages;
  };
  void add_row(const Want& want, Collected& collected);
  void add_part(const Want& want, const PartKey& key, bool is_there, Collected& collected);
  void miss_page(std::uint64_t number, bool needed, Collected& collected);
  void miss(const PartKey& key, std::uint64_t& parts);
  [[nodiscard]] bool can_ask(const PartKey& key) const { return !in_flight_.contains(key) && !has_failed(key); }
  [[nodiscard]] bool has_failed(const PartKey& key) const;
  void note_too_large(const PartKey& key);
  [[nodiscard]] bool submit(LoadRun run, bool may_evict);
  [[nodiscard]] bool reserve(PartLoad& part, bool may_evict);
  void arrive(PartLoad& part, Arrivals& arrivals);

  PagedVolume& paged_;
  RowReader& reader_;
  const std::uint64_t most_in_flight_;
  std::optional<ValueVisibility> visibility_;
  std::vector<PartPointer> pinned_;

  Pages pages_;
  std::map<PartKey, IndexPageLoad> pages_ahead_;  // pages that the next view may need
  std::unordered_map<std::uint64_t, Row> rows_;
  std::unordered_map<std::uint64_t, Want> wants_;
  std::map<PartKey, std::uint64_t> in_flight_;  // bytes of each
  std::uint64_t bytes_in_flight_ = 0;
  std::uint64_t largest_index_page_ = 0;  // bytes in memory, so far
  std::set<PartKey> failed_;
  std::set<PartKey> too_large_;  // for what memory is left
  std::set<PartKey> told_;       // of these, those whose errors have been told
  std::vector<Error> errors_;
  Missing missing_;
  std::uint64_t needed_bytes_ = 0;
  Loader loader_;  // last: its threads end first
};

}  // namespace splatvol
