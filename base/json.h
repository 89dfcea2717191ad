// Texts of JSON. They are read and written in one place: the library's templates take seconds to compile in each source
// that calls them.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>

namespace splatvol {

/// Reads a text. Throws what the library throws (nlohmann::json::parse_error).
[[nodiscard]] nlohmann::json parse_json(std::string_view text);

/// The same without exceptions: a text that is no JSON gives a value of the type `discarded`.
[[nodiscard]] nlohmann::json parse_json_or_discard(std::string_view text);

/// The same as parse_json; objects keep the order of their members.
[[nodiscard]] nlohmann::ordered_json parse_ordered_json(std::string_view text);

/// Writes a value; U+FFFD stands for bytes that are no UTF-8. `indent`: spaces for each level; below 0: all in one
/// line.
[[nodiscard]] std::string json_text(const nlohmann::json& value, int indent = -1);
[[nodiscard]] std::string json_text(const nlohmann::ordered_json& value, int indent = -1);

}  // namespace splatvol
