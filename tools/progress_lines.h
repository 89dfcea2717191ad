// Lines of JSON for the program that started this one. Each is written at once.
#pragma once

#include <nlohmann/json_fwd.hpp>

namespace splatvol {

class ProgressLines {
 public:
  void print(const nlohmann::ordered_json& value) const;

  /// Whether the last line of progress is old enough for another one. Then that is the last.
  [[nodiscard]] bool is_due();

 private:
  double last_ = 0;
};

}  // namespace splatvol
