#include "viewer/recent_files.h"

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <utility>

#include "base/file.h"
#include "base/json.h"

namespace splatvol {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t most_files = 12;

std::vector<std::string> read_list(const std::string& path) {
  const auto text = read_text_file(path);
  const auto document = parse_shallow_json(text.value_or(""), 1);
  std::vector<std::string> paths;
  if (!document) return paths;
  const JsonField list(**document);
  for (std::size_t i = 0; i < list.size() && paths.size() < most_files; ++i)
    if (auto entry = list.element(i).text()) paths.push_back(std::move(*entry));
  return paths;
}

}  // namespace

std::string usual_recent_files_path() {
  const char* state = std::getenv("XDG_STATE_HOME");
  const char* home = std::getenv("HOME");
  if (state && *state == '/') return std::string(state) + "/splatvol/recent.json";
  if (home && *home == '/') return std::string(home) + "/.local/state/splatvol/recent.json";
  return {};
}

RecentFiles::RecentFiles(std::string path) : path_(std::move(path)) {
  if (!path_.empty()) paths_ = read_list(path_);
}

void RecentFiles::add(const std::string& file) {
  std::error_code error;
  // A password or a token may be in an address of a web server.
  if (is_url(file) && !file.starts_with("ssh:") && file.find_first_of("@?") != std::string::npos) return;
  const std::string name = is_url(file) ? file : fs::absolute(file, error).lexically_normal().string();
  if (name.empty()) return;
  // Another window may have added files meanwhile.
  if (!path_.empty())
    if (auto listed = read_list(path_); !listed.empty()) paths_ = std::move(listed);
  std::erase(paths_, name);
  paths_.insert(paths_.begin(), name);
  if (paths_.size() > most_files) paths_.resize(most_files);
  if (path_.empty()) return;
  fs::create_directories(fs::path(path_).parent_path(), error);
  const nlohmann::json list = paths_;
  static_cast<void>(write_text_file(path_, json_text(list, 1) + "\n"));
}

}  // namespace splatvol
