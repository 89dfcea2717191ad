// What a build has read: a later look tells whether all of it is still the same.
#pragma once

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/json.h"
#include "builder/sources/process/reader_process.h"

namespace splatvol {

/// A file as it was. Times are nanoseconds since 1970. The second one changes with the file's owner, rights and links,
/// too, and no program can set it back.
struct FileState {
  std::string path;
  std::int64_t bytes = -1;  // -1: it was not there
  std::int64_t written = 0, changed = 0;

  bool operator==(const FileState&) const = default;
};

/// Looks at a file, or at what a link leads to.
[[nodiscard]] FileState state_of_file(const std::string& path);

/// The names in a folder, but those that begin with a dot.
struct FolderState {
  std::string path;
  bool with_folders = false;  // also the names in its folders, at any depth
  std::uint64_t names = 0;    // their hash; 0: the folder was not there
  std::int64_t changed = 0;   // as of FileState; not compared

  bool operator==(const FolderState& other) const {
    return path == other.path && with_folders == other.with_folders && names == other.names;
  }
};

[[nodiscard]] FolderState state_of_folder(const std::string& path, bool with_folders);

struct InputState {
  std::vector<FileState> files;
  std::vector<FolderState> folders;

  /// Whether all files and folders are as they were.
  [[nodiscard]] bool is_current() const;
};

/// Looks at the inputs of a build, and at what it has read of them:
/// - the inputs themselves, and the files of folders that are inputs;
/// - all that the reader process has opened, and what it looked for in vain. If it tells of nothing, all files that the
///   inputs name (input_files);
/// - the names in folders that are inputs, or were looked into: a new time step is a new name. Of a case of OpenFOAM,
///   at any depth.
[[nodiscard]] InputState state_of_inputs(const std::vector<std::string>& inputs, const ReadFiles& read);

/// Tells whether inputs stay as they are while they are read.
class InputWatch {
 public:
  /// Looks at the inputs, and waits for 20 milliseconds: the times of files go in steps.
  explicit InputWatch(const std::vector<std::string>& inputs);

  /// Whether nothing of `state` has changed since then. `state`: state_of_inputs after the read.
  [[nodiscard]] bool is_unchanged(const InputState& state) const;

 private:
  InputState before_;
  std::int64_t start_ = 0;
};

/// Returns the path of an input that a cache knows it by: absolute, without links, but for the last part of a file's
/// path. What such a link names lies beside the link.
[[nodiscard]] std::string canonical_input(const std::string& input);

[[nodiscard]] nlohmann::ordered_json to_json(const InputState& state);
[[nodiscard]] Result<InputState> input_state_of(const JsonField& field);
[[nodiscard]] nlohmann::ordered_json to_json(const FileState& file);
[[nodiscard]] Result<FileState> file_state_of(const JsonField& field);

}  // namespace splatvol
