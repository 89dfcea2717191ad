#include "tools/svbuild_cached.h"

#include <fmt/chrono.h>
#include <fmt/ranges.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <new>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>
#include <variant>

#include "base/byte_text.h"
#include "base/file.h"
#include "base/json.h"
#include "base/low_priority.h"
#include "base/printable.h"
#include "base/temporary_names.h"
#include "builder/cache/build_cache.h"
#include "tools/ending.h"
#include "tools/progress_lines.h"
#include "tools/reading.h"
#include "tools/tool.h"
#include "tools/version.h"

namespace splatvol {
namespace {

constexpr const char* other_ways = "give -o OUT.svol, or another folder in SPLATVOL_CACHE";

nlohmann::ordered_json line_of(const BuildShare::State& state) {
  nlohmann::ordered_json line = {{"stage", state.stage}, {"share", std::floor(1e4 * state.share) / 1e4}};
  line["seconds_left"] =
      state.seconds_left ? nlohmann::ordered_json(std::round(10 * *state.seconds_left) / 10) : nullptr;
  return line;
}

// A build on behalf of another program gives way to what somebody looks at.
void lower_priority() {
  if (::getpriority(PRIO_PROCESS, 0) < 10) lower_thread_priority();
}

// The program is a part of what a file depends on: a new one builds anew.
std::string program_text() {
  std::string text = SPLATVOL_VERSION;
  for (const std::string& program : {std::string("/proc/self/exe"), find_program("splatvol-read")}) {
    const FileState state = state_of_file(program);
    text += fmt::format(" {} {}", state.bytes, state.written);
  }
  return text;
}

Status check_inputs(const std::vector<std::string>& inputs) {
  SPLATVOL_TRY(check_no_address(inputs));
  for (const std::string& input : inputs) {
    if (has_extension(input, ".svol") || has_extension(input, ".svols"))
      return fail(ErrorCode::invalid_argument, "{}: is built already: open it as it is", input);
  }
  return {};
}

CacheKey key_of(const CachedBuild& build) {
  CacheKey key{.choices = build.choices + " " + program_text()};
  for (const std::string& input : build.inputs) key.inputs.push_back(canonical_input(input));
  return key;
}

// A folder of this user's for files that are not kept.
std::string folder_for_temporaries() {
  std::error_code error;
  const std::filesystem::path folder = std::filesystem::temp_directory_path(error);
  return ((error ? "/tmp" : folder) / fmt::format("splatvol-{}", ::geteuid())).string();
}

// The caller's end of the pipe closes when it has the file open, or needs it no more.
void wait_for_end_of_input() {
  std::array<char, 256> ignored;
  for (;;)
    if (const ssize_t got = ::read(STDIN_FILENO, ignored.data(), ignored.size());
        got == 0 || (got < 0 && errno != EINTR))
      return;
}

class CachedRun {
 public:
  CachedRun(const CacheOptions& options, const CachedBuild& build)
      : options_(options), build_(build), key_(key_of(build)), bar_("reading") {}

  Status run() {
    SPLATVOL_TRY(check_inputs(build_.inputs));
    if (!options_.preview.empty()) SPLATVOL_TRY(check_outputs({options_.preview}, build_.inputs));
    SPLATVOL_TRY(open_cache());
    auto place = find();
    if (!place) return tl::unexpected(place.error());
    if (*place) SPLATVOL_TRY(build_in(std::move(**place)));
    return finish();
  }

 private:
  // A cache that cannot be used is told, and one for this run takes its place.
  Status open_cache() {
    const std::string folder = usual_cache_folder();
    std::string reason = "there is no cache: SPLATVOL_CACHE is empty";
    if (!folder.empty()) {
      auto cache = BuildCache::open(folder);
      if (cache) {
        cache_.emplace(std::move(*cache));
        return {};
      }
      reason = cache.error().message;
    }
    return use_temporary(without_cache(reason));
  }

  // Nobody would see a temporary file without progress: that is an error then.
  Status use_temporary(const std::string& note) {
    if (!options_.progress) return fail(ErrorCode::io, "{}", note);
    notes_.push_back("the file is temporary: " + note);
    is_temporary_ = true;
    return {};
  }

  // Returns nothing if the file is there.
  Result<std::optional<BuildCache::Place>> find() {
    if (!is_temporary_) {
      auto found = cache_->find(key_, [this]() -> Status {
        show({.stage = "waits"});
        return {};
      });
      if (found) {
        if (auto* built = std::get_if<BuildCache::Built>(&*found)) {
          built_.emplace(std::move(*built));
          return std::optional<BuildCache::Place>();
        }
        return std::optional(std::move(std::get<BuildCache::Place>(*found)));
      }
      SPLATVOL_TRY(use_temporary(without_cache(found.error().message)));
    }
    SPLATVOL_TRY_ASSIGN(folder, BuildCache::open(folder_for_temporaries()));
    SPLATVOL_TRY_ASSIGN(place, folder.make_place(key_));
    return std::optional(std::move(place));
  }

  Status build_in(BuildCache::Place place) {
    was_built_ = true;
    const InputWatch watch(build_.inputs);
    auto outcome = build_.build(
        place.folder() + "/" + build_.name, [this](const BuildShare::State& state) { show(state); },
        [this](const std::string& file) {
          // Until the whole file is there, it goes with this process.
          note_temporary(file);
          if (options_.progress) lines_.print({{"preview", file}});
        });
    if (!outcome) return explain(place, outcome.error());
    bar_.reset();
    notes_.insert(notes_.end(), outcome->notes.begin(), outcome->notes.end());
    const InputState read = state_of_inputs(build_.inputs, outcome->read);
    if (!outcome->read.are_all || !watch.is_unchanged(read)) {
      SPLATVOL_TRY(use_temporary("the input changed while it was read: open it again once it is written"));
    } else if (!is_temporary_) {
      auto built = cache_->keep(place, key_, build_.name, read, outcome->notes);
      if (built) {
        built_.emplace(std::move(*built));
        return {};
      }
      SPLATVOL_TRY(use_temporary(without_cache(built.error().message)));
    }
    place_.emplace(std::move(place));  // it stays as long as this process
    return {};
  }

  static std::string without_cache(const std::string& reason) { return fmt::format("{}; {}", reason, other_ways); }

  // Nobody knows the folder of the cache by heart.
  static Status explain(const BuildCache::Place& place, const Error& error) {
    if (error.message.find(one_line(place.folder())) == std::string::npos) return tl::unexpected(error);
    return fail(error.code, "{}", without_cache(error.message));
  }

  [[nodiscard]] std::string file() const { return built_ ? built_->file : place_->folder() + "/" + build_.name; }

  Status finish() {
    if (!options_.preview.empty()) forget_temporary(options_.preview);
    if (!was_built_) notes_.insert(notes_.end(), built_->notes.begin(), built_->notes.end());
    const nlohmann::ordered_json result = {{"file", file()},
                                           {"built", was_built_},
                                           {"temporary", is_temporary_},
                                           {"seconds", seconds_now() - start_},
                                           {"notes", notes_}};
    if (options_.progress) {
      say_when_interrupted(nullptr);
      lines_.print({{"result", result}});
      wait_for_end_of_input();
    } else if (build_.json) {
      fmt::print("{}\n", json_text(result, 1));
    } else {
      fmt::print("{}\n", file());
      for (const std::string& note : notes_) fmt::print(stderr, "warning: {}\n", one_line(note));
    }
    return {};
  }

  void show(const BuildShare::State& state) {
    if (options_.progress) {
      if (lines_.is_due()) lines_.print(line_of(state));
      return;
    }
    bar_->rename(state.stage);
    bar_->update(state.share);
  }

  const CacheOptions& options_;
  const CachedBuild& build_;
  double start_ = seconds_now();
  CacheKey key_;
  std::optional<BuildCache> cache_;
  std::optional<BuildCache::Built> built_;  // else it is in place_
  std::optional<BuildCache::Place> place_;
  std::vector<std::string> notes_;
  bool is_temporary_ = false, was_built_ = false;
  ProgressLines lines_;
  std::optional<ProgressBar> bar_;
};

Result<BuildCache> open_usual_cache() {
  const std::string folder = usual_cache_folder();
  if (folder.empty()) return fail(ErrorCode::io, "there is no cache: SPLATVOL_CACHE is empty");
  return BuildCache::open(folder);
}

std::string inputs_text(const BuildCache::Entry& entry) {
  return entry.inputs.empty() ? "(damaged)" : one_line(fmt::format("{}", fmt::join(entry.inputs, " ")));
}

std::string time_text(std::int64_t seconds) {
  return fmt::format("{:%Y-%m-%d %H:%M}", fmt::localtime(static_cast<std::time_t>(seconds)));
}

}  // namespace

void add_cache_options(CommandLine& app, CacheOptions& options) {
  app.add_flag("--cached", options.cached,
               "Print the path of a file with cells and boundary that is kept in a cache, and build it only if it is "
               "not there or the input has changed. Of an input with time steps the last one, unless --time, --times "
               "or --series-of-files say otherwise. The cache is $SPLATVOL_CACHE, else ~/.cache/splatvol; it holds 20 "
               "GB at most, and no more than is free beside it. Runs at a low priority, and ends with the program that "
               "started it");
  app.add_flag("--progress", options.progress,
               "With --cached, for programs: print lines of JSON, the last with the result, and hold the file until "
               "the standard input ends");
  app.add_option("--preview", options.preview,
                 "With --cached: write this file from some of the points as soon as the input is read, if it has more "
                 "than 100,000")
      ->type_name("FILE.svol")
      ->check(check_svol_path);
  app.add_flag("--cache", options.list, "List what the cache holds");
  app.add_flag("--forget", options.forget,
               "Remove from the cache what was built from these inputs, or all without an input. Files that are open "
               "stay");
}

Status build_cached(const CacheOptions& options, const CachedBuild& build) {
  if (options.progress) say_when_interrupted("{\"error\":\"interrupted\"}\n");
  end_with_parent();
  lower_priority();
  const auto run = [&]() -> Status {
    try {
      return CachedRun(options, build).run();
    } catch (const std::bad_alloc&) {
      return fail(ErrorCode::out_of_budget, "not enough memory");
    }
  };
  Status done = run();
  if (!done && options.progress) ProgressLines().print({{"error", done.error().message}});
  return done;
}

Status list_cache(bool json) {
  SPLATVOL_TRY_ASSIGN(cache, open_usual_cache());
  SPLATVOL_TRY_ASSIGN(entries, cache.list());
  nlohmann::ordered_json document = nlohmann::ordered_json::array();
  for (const BuildCache::Entry& entry : entries)
    document.push_back({{"inputs", entry.inputs},
                        {"bytes", entry.bytes},
                        {"used", entry.used},
                        {"open", entry.is_open},
                        {"file", entry.file}});
  if (json) {
    fmt::print("{}\n", json_text(document, 1));
    return {};
  }
  for (const BuildCache::Entry& entry : entries)
    print_out("{}\n  {}, used {}{}: {}\n", inputs_text(entry), byte_text(static_cast<double>(entry.bytes)),
              time_text(entry.used), entry.is_open ? ", open" : "", entry.file);
  return {};
}

Status forget_in_cache(const std::vector<std::string>& inputs) {
  SPLATVOL_TRY_ASSIGN(cache, open_usual_cache());
  std::vector<std::string> canonical;
  for (const std::string& input : inputs) canonical.push_back(canonical_input(input));
  SPLATVOL_TRY_ASSIGN(forgotten, cache.forget(canonical));
  for (const BuildCache::Entry& entry : forgotten.removed)
    print_out("removed: {}, {}\n", inputs_text(entry), byte_text(static_cast<double>(entry.bytes)));
  for (const BuildCache::Entry& entry : forgotten.open) print_out("is open, and stays: {}\n", inputs_text(entry));
  return {};
}

}  // namespace splatvol
