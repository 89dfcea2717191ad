// Numbers in text that single precision does not keep.
#pragma once

#include <string_view>

namespace splatvol {

/// Whether a text holds a number with more digits than single precision keeps: rounding changes it by more than half a
/// unit of its last digit. Whole numbers do not count: they are indices. Safe on any text.
[[nodiscard]] bool has_finer_number(std::string_view text);

}  // namespace splatvol
