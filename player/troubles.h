// Errors that do not end what a program does.
#pragma once

#include <string>
#include <unordered_set>
#include <utility>
#include <vector>

namespace splatvol {

class Troubles {
 public:
  void add(std::string trouble) { all_.push_back(std::move(trouble)); }

  /// Adds one that comes back with each picture, as of a part that cannot be read.
  void add_once(const std::string& trouble) {
    if (once_.insert(trouble).second) add(trouble);
  }

  /// Returns them, the newest last.
  [[nodiscard]] const std::vector<std::string>& all() const { return all_; }

 private:
  std::vector<std::string> all_;
  std::unordered_set<std::string> once_;
};

}  // namespace splatvol
