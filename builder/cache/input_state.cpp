#include "builder/cache/input_state.h"

#include <sys/stat.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <span>
#include <string_view>
#include <system_error>
#include <thread>

#include "base/input_formats.h"
#include "builder/opening/input_files.h"
#include "builder/sources/process/input_bytes.h"
#include "format/codec.h"

namespace splatvol {
namespace {

namespace fs = std::filesystem;

// The kernel's clock for the times of files goes in steps of at most this.
constexpr std::int64_t clock_step = 10'000'000;

std::int64_t nanoseconds(const timespec& time) { return std::int64_t{time.tv_sec} * 1'000'000'000 + time.tv_nsec; }

std::int64_t now() {
  const auto time = std::chrono::system_clock::now().time_since_epoch();
  return std::chrono::duration_cast<std::chrono::nanoseconds>(time).count();
}

// Whether the system makes up the file on each read.
bool is_of_system(std::string_view path) {
  return std::ranges::any_of(std::initializer_list<std::string_view>{"/proc/", "/sys/", "/dev/"},
                             [&](std::string_view folder) { return path.starts_with(folder); });
}

std::string absolute(const std::string& path) {
  std::error_code error;
  const fs::path found = fs::absolute(path, error);
  return error ? path : found.string();
}

// Collects what is looked at, each once.
class Look {
 public:
  void at_file(const std::string& path, bool was_there = false) {
    const std::string file = absolute(path);
    std::error_code error;
    if (is_of_system(file) || !files_.insert(file).second) return;
    if (fs::is_directory(file, error)) return at_folder(file, false);
    FileState state = state_of_file(file);
    if (was_there && state.bytes < 0) state.changed = now();  // no later look finds this
    state_.files.push_back(std::move(state));
  }

  void at_folder(const std::string& path, bool with_folders) {
    const std::string folder = absolute(path);
    if (is_of_system(folder + "/") || !folders_.insert(folder).second) return;
    state_.folders.push_back(state_of_folder(folder, with_folders));
  }

  [[nodiscard]] InputState take() { return std::move(state_); }

 private:
  InputState state_;
  std::set<std::string> files_, folders_;
};

// The case of OpenFOAM that a file stands for.
std::string case_of(const std::string& file) {
  const fs::path path(file);
  return (path.filename() == "controlDict" ? path.parent_path().parent_path() : path.parent_path()).string();
}

void look_at_folders(const std::string& input, Look& look) {
  std::error_code error;
  if (fs::is_directory(input, error)) return look.at_folder(input, is_openfoam_case(input));
  if (format_of_name(input) == InputFormat::openfoam) look.at_folder(case_of(absolute(input)), true);
}

template <class Integer>
Result<Integer> natural(const JsonField& field, std::string_view name) {
  return field.member(name).whole(Integer{0}, std::numeric_limits<Integer>::max());
}

}  // namespace

FileState state_of_file(const std::string& path) {
  struct stat status {};
  if (::stat(path.c_str(), &status) != 0) return {.path = path};
  return {path, status.st_size, nanoseconds(status.st_mtim), nanoseconds(status.st_ctim)};
}

FolderState state_of_folder(const std::string& path, bool with_folders) {
  FolderState state{.path = path, .with_folders = with_folders};
  struct stat status {};
  std::error_code error;
  if (::stat(path.c_str(), &status) != 0) return state;
  state.changed = nanoseconds(status.st_ctim);
  std::vector<std::string> names;
  for (fs::recursive_directory_iterator entry(path, fs::directory_options::skip_permission_denied, error), end;
       !error && entry != end; entry.increment(error)) {
    const std::string name = entry->path().filename();
    if (!with_folders || name.starts_with('.')) entry.disable_recursion_pending();
    if (!name.starts_with('.')) names.push_back(entry->path().string().substr(path.size()));
  }
  std::ranges::sort(names);
  format::StreamHash hash;
  for (const std::string& name : names) hash.add(std::as_bytes(std::span(name.c_str(), name.size() + 1)));
  state.names = hash.value() | 1;
  return state;
}

bool InputState::is_current() const {
  return std::ranges::all_of(files, [](const FileState& file) { return state_of_file(file.path) == file; }) &&
         std::ranges::all_of(folders, [](const FolderState& folder) {
           return state_of_folder(folder.path, folder.with_folders) == folder;
         });
}

InputState state_of_inputs(const std::vector<std::string>& inputs, const ReadFiles& read) {
  Look look;
  for (const std::string& input : inputs) look_at_folders(input, look);
  if (const auto paths = expand_folders(inputs))
    for (const std::string& path : *paths) look.at_file(path);
  if (read.opened.empty())
    for (const std::string& path : input_files(inputs)) look.at_file(path);
  for (const std::string& path : read.opened) look.at_file(path, true);
  for (const std::string& path : read.missing) look.at_file(path);
  return look.take();
}

// Whatever was written before this call is older than the start by more than a step then, also files that only a link
// names.
InputWatch::InputWatch(const std::vector<std::string>& inputs) : before_(state_of_inputs(inputs, {})) {
  std::this_thread::sleep_for(std::chrono::nanoseconds(2 * clock_step));
  start_ = now();
}

bool InputWatch::is_unchanged(const InputState& state) const {
  std::map<std::string, const FileState*> known;
  for (const FileState& file : before_.files) known.emplace(file.path, &file);
  const auto is_settled = [&](const FileState& file) {
    const auto found = known.find(file.path);
    return found != known.end() ? file == *found->second : std::max(file.written, file.changed) < start_ - clock_step;
  };
  const auto is_settled_folder = [&](const FolderState& folder) {
    return std::ranges::find(before_.folders, folder) != before_.folders.end() || folder.changed < start_ - clock_step;
  };
  return before_.is_current() && std::ranges::all_of(state.files, is_settled) &&
         std::ranges::all_of(state.folders, is_settled_folder);
}

std::string canonical_input(const std::string& input) {
  std::error_code error;
  const fs::path path = fs::absolute(input, error);
  if (fs::is_directory(path, error)) return fs::weakly_canonical(path, error).string();
  const fs::path folder = fs::weakly_canonical(path.parent_path(), error);
  return error ? path.string() : (folder / path.filename()).string();
}

nlohmann::ordered_json to_json(const FileState& file) {
  const auto bytes = file.bytes < 0 ? nlohmann::ordered_json() : nlohmann::ordered_json(file.bytes);
  return {{"path", file.path}, {"bytes", bytes}, {"written", file.written}, {"changed", file.changed}};
}

Result<FileState> file_state_of(const JsonField& field) {
  FileState file;
  SPLATVOL_TRY_SET(file.path, field.member("path").text());
  if (!field.member("bytes").is_null()) SPLATVOL_TRY_SET(file.bytes, natural<std::int64_t>(field, "bytes"));
  SPLATVOL_TRY_SET(file.written, natural<std::int64_t>(field, "written"));
  SPLATVOL_TRY_SET(file.changed, natural<std::int64_t>(field, "changed"));
  return file;
}

nlohmann::ordered_json to_json(const InputState& state) {
  nlohmann::ordered_json files = nlohmann::ordered_json::array(), folders = files;
  for (const FileState& file : state.files) files.push_back(to_json(file));
  for (const FolderState& folder : state.folders)
    folders.push_back({{"path", folder.path}, {"with_folders", folder.with_folders}, {"names", folder.names}});
  return {{"files", std::move(files)}, {"folders", std::move(folders)}};
}

Result<InputState> input_state_of(const JsonField& field) {
  const auto folder_of = [](const JsonField& of_folder) -> Result<FolderState> {
    FolderState folder;
    SPLATVOL_TRY_SET(folder.path, of_folder.member("path").text());
    SPLATVOL_TRY_SET(folder.with_folders, of_folder.member("with_folders").truth());
    SPLATVOL_TRY_SET(folder.names, natural<std::uint64_t>(of_folder, "names"));
    return folder;
  };
  InputState state;
  SPLATVOL_TRY_SET(state.files, field.member("files").each(file_state_of));
  SPLATVOL_TRY_SET(state.folders, field.member("folders").each(folder_of));
  return state;
}

}  // namespace splatvol
