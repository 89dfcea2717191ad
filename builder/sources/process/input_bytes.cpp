#include "builder/sources/process/input_bytes.h"

#include <algorithm>
#include <filesystem>
#include <set>
#include <string_view>
#include <system_error>

#include "base/file.h"
#include "base/input_formats.h"
#include "base/names.h"
#include "builder/sources/read_text.h"

namespace splatvol {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t most_looks = std::size_t{1} << 20;

class InputFiles {
 public:
  [[nodiscard]] std::uint64_t bytes() const { return bytes_; }
  [[nodiscard]] const std::set<std::string>& paths() const { return seen_; }

  /// Adds a file or a folder with all that it stands for, once. Ignores what is not there.
  void add(const fs::path& path) {
    std::error_code error;
    if (!may_look()) return;
    if (fs::is_directory(path, error)) return add_folder(path);
    if (!fs::is_regular_file(path, error) || !seen_.insert(path.lexically_normal().string()).second) return;
    if (const auto size = fs::file_size(path, error); !error) bytes_ += size;
    add_others(path);
  }

 private:
  /// A text may name more than can be looked for.
  bool may_look() { return ++looks_ <= most_looks; }

  void add_others(const fs::path& path) {
    const std::string extension = in_lower_case(path.extension().string());
    const auto format = format_of_name(path.string());
    if (path.filename() == "controlDict") return add_folder(path.parent_path().parent_path());
    if (format == InputFormat::openfoam) return add_folder(path.parent_path());
    if (format == InputFormat::vtk_series || format == InputFormat::vtk_parallel || format == InputFormat::vtk_blocks ||
        extension == ".gltf")
      return add_named(path, "\"'");
    if (format == InputFormat::ensight) return add_named(path, " \t\r\n");
    // "mesh.e.4.0" is the first of four parts.
    const bool is_part = extension.size() > 1 && extension.find_first_not_of("0123456789", 1) == std::string::npos;
    if (is_part) add_matching(path.parent_path(), path.stem().string() + ".*");
  }

  void add_folder(const fs::path& folder) {
    std::error_code error;
    for (fs::recursive_directory_iterator entry(folder, error), end; !error && entry != end && may_look();
         entry.increment(error)) {
      std::error_code ignored;
      if (entry->is_regular_file(ignored)) add(entry->path());
    }
  }

  /// Adds the files in a folder whose names are as a pattern says.
  void add_matching(const fs::path& folder, const std::string& pattern) {
    std::error_code error;
    for (fs::directory_iterator entry(folder.empty() ? "." : folder, error), end; !error && entry != end && may_look();
         entry.increment(error))
      if (matches(entry->path().filename().string(), pattern)) add(entry->path());
  }

  /// Adds the files that a text names between `separators`. Data in the text is no name.
  void add_named(const fs::path& path, std::string_view separators) {
    constexpr std::size_t longest_name = 4096;
    const auto text = read_text_file(path.string());
    if (!text) return;
    for (std::string_view rest = *text; !rest.empty() && looks_ < most_looks;) {
      const std::size_t end = std::min(rest.find_first_of(separators), rest.size());
      if (end > 0 && end < longest_name) add_name(path.parent_path(), std::string(rest.substr(0, end)));
      rest.remove_prefix(std::min(end + 1, rest.size()));
    }
  }

  void add_name(const fs::path& folder, const std::string& name) {
    const fs::path path = folder / name;
    if (name.find('*') != std::string::npos) return add_matching(path.parent_path(), path.filename().string());
    std::error_code error;
    if (may_look() && fs::is_regular_file(path, error)) add(path);
  }

  std::set<std::string> seen_;
  std::size_t looks_ = 0;
  std::uint64_t bytes_ = 0;
};

}  // namespace

std::uint64_t input_bytes(const std::vector<std::string>& inputs) {
  InputFiles files;
  for (const std::string& input : inputs) files.add(input);
  return files.bytes();
}

std::vector<std::string> input_files(const std::vector<std::string>& inputs) {
  InputFiles files;
  for (const std::string& input : inputs) files.add(input);
  return {files.paths().begin(), files.paths().end()};
}

}  // namespace splatvol
