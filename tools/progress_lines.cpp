#include "tools/progress_lines.h"

#include <unistd.h>

#include <nlohmann/json.hpp>

#include "base/json.h"
#include "tools/tool.h"

namespace splatvol {

void ProgressLines::print(const nlohmann::ordered_json& value) const {
  const std::string line = json_text(value) + "\n";
  (void)!::write(STDOUT_FILENO, line.data(), line.size());
}

bool ProgressLines::is_due() {
  constexpr double least_seconds_between_lines = 0.1;
  const double now = seconds_now();
  if (now - last_ < least_seconds_between_lines) return false;
  last_ = now;
  return true;
}

}  // namespace splatvol
