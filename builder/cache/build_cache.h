// A folder of files that were built before, for the next time that somebody wants them.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "base/error.h"
#include "builder/cache/file_lock.h"
#include "builder/cache/input_state.h"

namespace splatvol {

/// Returns the folder of this user's cache: $SPLATVOL_CACHE, else $XDG_CACHE_HOME/splatvol, else ~/.cache/splatvol.
/// Empty: there is to be none.
[[nodiscard]] std::string usual_cache_folder();

/// Names the inputs and the choices of a build. Equal keys give equal files.
struct CacheKey {
  std::vector<std::string> inputs = {};  // canonical_input
  std::string choices = {};              // options and program, in any form
};

/// Built files. Each has a folder of its own, with the files that it names. `entry.json` there tells which files the
/// build has read.
///
/// Several processes use a cache at once. A short lock on `splatvol.lock` guards its names. The folder of an entry that
/// is being built begins with a dot, and its builder holds a lock on the file `lock` in it; without that lock, it is a
/// leftover. Nothing else in the folder is touched. Whoever reads a built file holds a shared lock on it (flock): such
/// an entry is not removed.
///
/// All functions fail if the folder cannot be read or written. Not thread-safe.
class BuildCache {
 public:
  static constexpr std::uint64_t usual_most_bytes = 20'000'000'000;

  /// Makes the folder for this user alone if there is none, and removes leftovers. Fails if it belongs to another user.
  /// `most_bytes`: the cache holds at most so many, and at most as many as are free beside it.
  [[nodiscard]] static Result<BuildCache> open(const std::string& folder, std::uint64_t most_bytes = usual_most_bytes);

  [[nodiscard]] const std::string& folder() const { return folder_; }

  /// A file that was built. It stays while this lives.
  struct Built {
    std::string file;
    std::vector<std::string> notes;
    FileLock lock;
  };

  /// An empty folder for a file that is to be built. Goes with this, unless keep() has taken it; no other process
  /// removes it, but for signals that end this one (base/temporary_names.h).
  class Place {
   public:
    Place(Place&& other) noexcept;
    Place& operator=(Place&&) = delete;
    ~Place();
    [[nodiscard]] const std::string& folder() const { return folder_; }

   private:
    friend class BuildCache;
    Place(std::string folder, FileLock lock) : folder_(std::move(folder)), lock_(std::move(lock)) {}

    std::string folder_;  // empty: it is kept
    FileLock lock_;
  };

  /// Returns the file of a key. Returns a place to build it in if there is none, if its inputs have changed, or if it
  /// is damaged. Its size, its times, header and index tell that. While another process builds it, calls `waits` about
  /// ten times a second; its failure ends the wait.
  [[nodiscard]] Result<std::variant<Built, Place>> find(const CacheKey& key, const std::function<Status()>& waits);

  /// Returns a place for a file that is not kept.
  [[nodiscard]] Result<Place> make_place(const CacheKey& key);

  /// Keeps the file `name` of a place, and what lies beside it. Removes others that were not used for the longest time
  /// until there is room. Fails with out_of_budget if the cache may not hold so much; then the place is as it was.
  [[nodiscard]] Result<Built> keep(Place& place, const CacheKey& key, const std::string& name, const InputState& read,
                                   std::vector<std::string> notes);

  struct Entry {
    std::string folder;
    std::vector<std::string> inputs = {};  // none, and no file: its record is damaged
    std::string file = {};
    std::uint64_t bytes = 0;
    std::int64_t used = 0;  // seconds since 1970, the last time
    bool is_open = false;
  };

  /// Returns what it holds, the last used first.
  [[nodiscard]] Result<std::vector<Entry>> list();

  /// Removes the entries of these inputs, or all if there are none, but those that are open. Returns those that it
  /// removed and those that are open.
  struct Forgotten {
    std::vector<Entry> removed, open;
  };
  [[nodiscard]] Result<Forgotten> forget(const std::vector<std::string>& inputs);

  /// The most bytes that it may hold now.
  [[nodiscard]] Result<std::uint64_t> room() const;

 private:
  BuildCache(std::string folder, std::uint64_t most_bytes) : folder_(std::move(folder)), most_bytes_(most_bytes) {}

  [[nodiscard]] Result<FileLock> lock() const;
  [[nodiscard]] Status remove_leftovers() const;
  [[nodiscard]] Result<Place> place_for(const std::string& hash) const;
  [[nodiscard]] std::optional<Built> find_built(const CacheKey& key) const;
  [[nodiscard]] Result<std::vector<std::string>> names() const;
  [[nodiscard]] Result<std::vector<Entry>> entries() const;
  [[nodiscard]] Status make_room(std::uint64_t bytes) const;

  std::string folder_;
  std::uint64_t most_bytes_;
};

}  // namespace splatvol
