#include "builder/cache/build_cache.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
#include <random>
#include <span>
#include <string_view>
#include <system_error>
#include <thread>
#include <utility>

#include "base/descriptor.h"
#include "base/file.h"
#include "base/temp_file.h"
#include "base/temporary_names.h"
#include "format/codec.h"
#include "format/steps.h"

namespace splatvol {
namespace {

namespace fs = std::filesystem;

constexpr const char* lock_name = "lock";                 // in the folder of a place
constexpr const char* names_lock_name = "splatvol.lock";  // in the cache
constexpr const char* entry_name = "entry.json";
constexpr auto wait_step = std::chrono::milliseconds(100);

std::string in(const std::string& folder, const std::string& name) { return folder + "/" + name; }

std::string text_of(const CacheKey& key) {
  std::string text = key.choices;
  for (const std::string& input : key.inputs) text += '\0' + input;
  return text;
}

std::string hash_of(const CacheKey& key) {
  const std::string text = text_of(key);
  return fmt::format("{:016x}", format::hash_bytes(std::as_bytes(std::span(text))));
}

// The folder of an entry that is being built.
bool is_place(const std::string& name) { return name.starts_with('.'); }

// Whether a name is that of an entry or a place: the hash of its key, and a number.
bool is_of_cache(std::string_view name) {
  if (name.starts_with('.')) name.remove_prefix(1);
  constexpr std::size_t hash_digits = 16, digits = hash_digits + 1 + 8;
  const auto is_hexadecimal = [](std::string_view text) {
    return text.find_first_not_of("0123456789abcdef") == std::string_view::npos;
  };
  return name.size() == digits && name[hash_digits] == '-' && is_hexadecimal(name.substr(0, hash_digits)) &&
         is_hexadecimal(name.substr(hash_digits + 1));
}

void remove_folder(const std::string& folder) {
  std::error_code ignored;
  fs::remove_all(folder, ignored);
}

// The contents of entry.json.
struct Record {
  CacheKey key;
  std::string file;
  std::vector<FileState> files;  // all that belong to it, by their names
  std::vector<std::string> notes;
  InputState read;
};

// The files in a folder, but for what belongs to the cache.
std::vector<FileState> files_in(const std::string& folder) {
  std::vector<FileState> files;
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end; entry.increment(error)) {
    FileState file = state_of_file(entry->path());
    file.path = entry->path().filename();
    if (file.path != lock_name && file.path != entry_name) files.push_back(std::move(file));
  }
  std::ranges::sort(files, {}, &FileState::path);
  return files;
}

std::uint64_t bytes_of(const std::vector<FileState>& files) {
  std::uint64_t sum = 0;
  for (const FileState& file : files) sum += static_cast<std::uint64_t>(std::max<std::int64_t>(file.bytes, 0));
  return sum;
}

std::string text_of(const Record& record) {
  nlohmann::ordered_json files = nlohmann::ordered_json::array();
  for (const FileState& file : record.files) files.push_back(to_json(file));
  return json_text(nlohmann::ordered_json{{"inputs", record.key.inputs},
                                          {"choices", record.key.choices},
                                          {"file", record.file},
                                          {"files", std::move(files)},
                                          {"notes", record.notes},
                                          {"read", to_json(record.read)}});
}

Result<Record> read_record(const std::string& folder) {
  SPLATVOL_TRY_ASSIGN(text, read_text_file(in(folder, entry_name)));
  const auto read = [](const JsonField& field) -> Result<Record> {
    Record record;
    SPLATVOL_TRY_SET(record.key.inputs, field.member("inputs").each(&JsonField::text));
    SPLATVOL_TRY_SET(record.key.choices, field.member("choices").text());
    SPLATVOL_TRY_SET(record.file, field.member("file").text());
    SPLATVOL_TRY_SET(record.files, field.member("files").each(file_state_of));
    SPLATVOL_TRY_SET(record.notes, field.member("notes").each(&JsonField::text));
    SPLATVOL_TRY_SET(record.read, input_state_of(field.member("read")));
    return record;
  };
  return read_json(text, read, 8);
}

// Whether the files are as they were built, as far as a look at header and index tells.
bool is_sound(const std::string& folder, const Record& record) {
  if (files_in(folder) != record.files) return false;
  const auto steps = format::Steps::open(in(folder, record.file), open_file);
  return steps && steps->volume(steps->last());
}

// Whether somebody reads a file of an entry.
bool is_open(const std::string& folder) {
  return std::ranges::any_of(files_in(folder), [&](const FileState& file) {
    const auto lock = FileLock::try_lock(in(folder, file.path), FileLock::Kind::exclusive);
    return lock && !*lock;
  });
}

// When an entry was used last is the time of its record.
std::int64_t use_of(const std::string& folder) { return state_of_file(in(folder, entry_name)).written / 1'000'000'000; }
void note_use(const std::string& folder) { (void)::utimensat(AT_FDCWD, in(folder, entry_name).c_str(), nullptr, 0); }

}  // namespace

std::string usual_cache_folder() {
  if (const char* folder = std::getenv("SPLATVOL_CACHE")) return folder;
  const char *caches = std::getenv("XDG_CACHE_HOME"), *home = std::getenv("HOME");
  if (caches && caches[0] == '/') return in(caches, "splatvol");
  return home && home[0] == '/' ? in(home, ".cache/splatvol") : std::string();
}

BuildCache::Place::Place(Place&& other) noexcept
    : folder_(std::exchange(other.folder_, {})), lock_(std::move(other.lock_)) {}

BuildCache::Place::~Place() {
  if (folder_.empty()) return;
  remove_folder(folder_);
  forget_temporary(folder_);
}

Result<BuildCache> BuildCache::open(const std::string& folder, std::uint64_t most_bytes) {
  std::error_code error;
  const fs::path path = fs::absolute(folder, error).lexically_normal();
  const std::string name = path.has_filename() ? path.string() : path.parent_path().string();
  fs::create_directories(fs::path(name).parent_path(), error);
  if (::mkdir(name.c_str(), 0700) != 0 && errno != EEXIST) return fail_errno(name, "cannot make the folder");
  struct stat status {};
  if (::stat(name.c_str(), &status) != 0) return fail_errno(name, "cannot look at it");
  if (!S_ISDIR(status.st_mode)) return fail(ErrorCode::io, "{}: is not a folder", name);
  if (status.st_uid != ::geteuid()) return fail(ErrorCode::io, "{}: the folder belongs to another user", name);
  BuildCache cache(name, most_bytes);
  SPLATVOL_TRY_ASSIGN(lock, cache.lock());
  SPLATVOL_TRY(cache.remove_leftovers());
  return cache;
}

Result<FileLock> BuildCache::lock() const { return FileLock::wait_for(in(folder_, names_lock_name)); }

// The folders of entries and places.
Result<std::vector<std::string>> BuildCache::names() const {
  std::vector<std::string> all;
  std::error_code error;
  for (fs::directory_iterator entry(folder_, error), end; !error && entry != end; entry.increment(error)) {
    std::error_code ignored;
    std::string name = entry->path().filename();
    if (is_of_cache(name) && entry->is_directory(ignored)) all.push_back(std::move(name));
  }
  if (error) return fail(ErrorCode::io, "{}: {}", folder_, error.message());
  return all;
}

// Without locks, nobody knows whether a builder still lives: then a day must do.
Status BuildCache::remove_leftovers() const {
  SPLATVOL_TRY_ASSIGN(all, names());
  const auto is_old = [](const std::string& file) {
    const auto day = std::chrono::seconds(std::chrono::hours(24)).count();
    return std::time(nullptr) - state_of_file(file).written / 1'000'000'000 > day;
  };
  for (const std::string& name : all) {
    if (!is_place(name)) continue;
    const std::string lock_file = in(in(folder_, name), lock_name);
    const auto lock = FileLock::try_lock(lock_file, FileLock::Kind::exclusive);
    if (lock && *lock && ((*lock)->is_real() || is_old(lock_file))) remove_folder(in(folder_, name));
  }
  return {};
}

Result<BuildCache::Place> BuildCache::place_for(const std::string& hash) const {
  std::random_device random;
  const std::string place = in(folder_, fmt::format(".{}-{:08x}", hash, random()));
  note_temporary(place);
  if (::mkdir(place.c_str(), 0700) != 0) {
    forget_temporary(place);
    return fail_errno(place, "cannot make the folder");
  }
  auto lock = FileLock::wait_for(in(place, lock_name));
  if (lock) return Place(place, std::move(*lock));
  remove_folder(place);
  forget_temporary(place);
  return tl::unexpected(lock.error());
}

// Removes entries of the key that are of no more use.
std::optional<BuildCache::Built> BuildCache::find_built(const CacheKey& key) const {
  const auto all = names();
  if (!all) return std::nullopt;
  const std::string hash = hash_of(key);
  for (const std::string& name : *all) {
    const std::string folder = in(folder_, name);
    if (!name.starts_with(hash)) continue;
    const auto record = read_record(folder);
    if (record && text_of(record->key) != text_of(key)) continue;
    if (record && record->read.is_current() && is_sound(folder, *record)) {
      auto lock = FileLock::try_lock(in(folder, record->file), FileLock::Kind::shared);
      if (!lock || !*lock) continue;
      note_use(folder);
      return Built{in(folder, record->file), record->notes, std::move(**lock)};
    }
    if (!is_open(folder)) remove_folder(folder);
  }
  return std::nullopt;
}

Result<std::variant<BuildCache::Built, BuildCache::Place>> BuildCache::find(const CacheKey& key,
                                                                            const std::function<Status()>& waits) {
  using Found = std::variant<Built, Place>;
  const std::string hash = hash_of(key);
  for (;; std::this_thread::sleep_for(wait_step)) {
    SPLATVOL_TRY_ASSIGN(names_lock, lock());
    SPLATVOL_TRY(remove_leftovers());
    if (auto built = find_built(key)) return Found(std::move(*built));
    SPLATVOL_TRY_ASSIGN(all, names());
    const bool is_being_built =
        std::ranges::any_of(all, [&](const std::string& name) { return is_place(name) && name.substr(1, 16) == hash; });
    if (!is_being_built) {
      SPLATVOL_TRY_ASSIGN(place, place_for(hash));
      return Found(std::move(place));
    }
    SPLATVOL_TRY(waits());
  }
}

Result<BuildCache::Place> BuildCache::make_place(const CacheKey& key) {
  SPLATVOL_TRY_ASSIGN(names_lock, lock());
  return place_for(hash_of(key));
}

Result<std::uint64_t> BuildCache::room() const {
  SPLATVOL_TRY_ASSIGN(all, names());
  SPLATVOL_TRY_ASSIGN(free, free_disk_bytes(folder_));
  std::uint64_t held = 0;
  for (const std::string& name : all) held += bytes_of(files_in(in(folder_, name)));
  return std::min(most_bytes_, (free + held) / 2);
}

Status BuildCache::make_room(std::uint64_t bytes) const {
  SPLATVOL_TRY_ASSIGN(most, room());
  if (bytes > most)
    return fail(ErrorCode::out_of_budget, "{}: the file has {} bytes, and the cache may hold {}", folder_, bytes, most);
  SPLATVOL_TRY_ASSIGN(all, entries());
  std::uint64_t held = bytes;
  for (const Entry& entry : all) {  // the last used first
    held += entry.bytes;
    if (held <= most || entry.is_open) continue;
    remove_folder(entry.folder);
    held -= entry.bytes;
  }
  return {};
}

Result<BuildCache::Built> BuildCache::keep(Place& place, const CacheKey& key, const std::string& name,
                                           const InputState& read, std::vector<std::string> notes) {
  SPLATVOL_TRY_ASSIGN(names_lock, lock());
  const Record record{key, name, files_in(place.folder_), std::move(notes), read};
  SPLATVOL_TRY(make_room(bytes_of(record.files)));
  SPLATVOL_TRY(write_text_file(in(place.folder_, entry_name), text_of(record)));
  SPLATVOL_TRY_ASSIGN(lock, FileLock::try_lock(in(place.folder_, name), FileLock::Kind::shared));
  const std::string folder = in(folder_, fs::path(place.folder_).filename().string().substr(1));
  if (!lock) return fail(ErrorCode::io, "{}: is locked by another program", in(place.folder_, name));
  if (::rename(place.folder_.c_str(), folder.c_str()) != 0) return fail_errno(folder, "cannot rename to");
  forget_temporary(std::exchange(place.folder_, {}));
  (void)::unlink(in(folder, lock_name).c_str());
  return Built{in(folder, name), record.notes, std::move(*lock)};
}

Result<std::vector<BuildCache::Entry>> BuildCache::entries() const {
  SPLATVOL_TRY_ASSIGN(all, names());
  std::vector<Entry> found;
  for (const std::string& name : all) {
    const std::string folder = in(folder_, name);
    if (is_place(name)) continue;
    Entry entry{.folder = folder, .bytes = bytes_of(files_in(folder)), .is_open = is_open(folder)};
    if (auto record = read_record(folder)) {
      entry.inputs = std::move(record->key.inputs);
      entry.file = in(folder, record->file);
      entry.used = use_of(folder);
    }
    found.push_back(std::move(entry));
  }
  std::ranges::stable_sort(found, std::ranges::greater(), &Entry::used);
  return found;
}

Result<std::vector<BuildCache::Entry>> BuildCache::list() {
  SPLATVOL_TRY_ASSIGN(names_lock, lock());
  return entries();
}

Result<BuildCache::Forgotten> BuildCache::forget(const std::vector<std::string>& inputs) {
  SPLATVOL_TRY_ASSIGN(names_lock, lock());
  SPLATVOL_TRY_ASSIGN(all, entries());
  Forgotten forgotten;
  const auto is_of_inputs = [&](const Entry& entry) {
    return inputs.empty() || std::ranges::any_of(entry.inputs, [&](const std::string& input) {
             return std::ranges::find(inputs, input) != inputs.end();
           });
  };
  for (Entry& entry : all) {
    if (!is_of_inputs(entry)) continue;
    if (!entry.is_open) remove_folder(entry.folder);
    (entry.is_open ? forgotten.open : forgotten.removed).push_back(std::move(entry));
  }
  return forgotten;
}

}  // namespace splatvol
