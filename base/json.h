// Texts of JSON, and checked reading of what they hold. The library is called in one place: its templates take seconds
// to compile in each source that calls them.
#pragma once

#include <concepts>
#include <cstdint>
#include <functional>
#include <initializer_list>
#include <limits>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "base/error.h"

namespace splatvol {

/// Reads a text. Throws what the library throws (nlohmann::json::parse_error).
[[nodiscard]] nlohmann::json parse_json(std::string_view text);

/// The same as parse_json; objects keep the order of their members.
[[nodiscard]] nlohmann::ordered_json parse_ordered_json(std::string_view text);

/// The same as parse_json, without exceptions. Fails with invalid_data if the text is no JSON, or is nested deeper than
/// `most_levels` (base/nesting.h).
[[nodiscard]] Result<std::shared_ptr<const nlohmann::json>> parse_shallow_json(std::string_view text, int most_levels);

/// Writes a value; U+FFFD stands for bytes that are no UTF-8. `indent`: spaces for each level; below 0: all in one
/// line.
[[nodiscard]] std::string json_text(const nlohmann::json& value, int indent = -1);
[[nodiscard]] std::string json_text(const nlohmann::ordered_json& value, int indent = -1);

/// A value of a document together with its path, so that every error names it: "cameras[2].up: not a list of 3
/// numbers". Errors have the code invalid_data. A field may be missing: reading it fails. Safe on untrusted documents.
///
/// The document must outlive its fields, and a field those that are made of it: an error makes the path from them.
class JsonField {
 public:
  explicit JsonField(const nlohmann::json& document) : value_(&document) {}
  explicit JsonField(nlohmann::json&& document) = delete;

  /// Return a part of an object, and of a list; a missing field if the part is not there. `name` must outlive the part.
  [[nodiscard]] JsonField member(std::string_view name) const&;
  [[nodiscard]] JsonField element(std::size_t index) const&;
  JsonField member(std::string_view name) const&& = delete;
  JsonField element(std::size_t index) const&& = delete;

  [[nodiscard]] bool exists() const { return value_ != nullptr; }
  [[nodiscard]] bool has(std::string_view name) const { return member(name).exists(); }
  [[nodiscard]] bool is_object() const;
  [[nodiscard]] bool is_list() const;
  [[nodiscard]] bool is_null() const;

  /// Returns the number of elements of a list; 0 for all else.
  [[nodiscard]] std::size_t size() const;

  /// Fails if this is no object, or has a member of another name that does not begin with "x-". A misspelt field would
  /// be ignored.
  [[nodiscard]] Status check_names(std::initializer_list<std::string_view> known) const;

  /// Returns a finite number of at most this magnitude.
  [[nodiscard]] Result<double> number(double largest = std::numeric_limits<double>::infinity()) const;

  /// As `number`; NaN for null.
  [[nodiscard]] Result<double> number_or_nan() const;

  /// Returns a whole number that is written without fraction and exponent. Requires 0 <= least.
  template <std::integral Integer>
  [[nodiscard]] Result<Integer> whole(Integer least, Integer most) const {
    return whole_number(static_cast<std::uint64_t>(least), static_cast<std::uint64_t>(most))
        .map([](std::uint64_t number) { return static_cast<Integer>(number); });
  }

  [[nodiscard]] Result<std::string> text() const;
  [[nodiscard]] Result<bool> truth() const;

  /// Returns a list of so many numbers, each as `number` returns it.
  [[nodiscard]] Result<std::vector<double>> numbers(std::size_t count,
                                                    double largest = std::numeric_limits<double>::infinity()) const;

  /// Returns what `read` makes of each element of a list, up to the first error.
  template <class Read>
  [[nodiscard]] auto each(const Read& read) const
      -> Result<std::vector<typename std::invoke_result_t<Read, JsonField>::value_type>> {
    if (!is_list()) return wrong("not a list");
    std::vector<typename std::invoke_result_t<Read, JsonField>::value_type> all;
    for (std::size_t i = 0; i < size(); ++i) {
      SPLATVOL_TRY_ASSIGN(one, std::invoke(read, element(i)));
      all.push_back(std::move(one));
    }
    return all;
  }

  /// Returns the value as JSON, in one line. Requires that it exists.
  [[nodiscard]] std::string json() const;

  /// Makes the error of this field: its path and what is wrong. The error of a missing field is that it is missing.
  template <class... Args>
  [[nodiscard]] tl::unexpected<Error> wrong(fmt::format_string<Args...> format, Args&&... args) const {
    return formatted_wrong(format, fmt::make_format_args(args...));
  }

  /// Returns where it is in the document, such as "cameras[2].up". Empty: it is the whole document.
  [[nodiscard]] std::string path() const;

 private:
  JsonField(const nlohmann::json* value, const JsonField* parent, std::string_view name, std::size_t index)
      : value_(value), parent_(parent), name_(name), index_(index) {}

  [[nodiscard]] Result<std::uint64_t> whole_number(std::uint64_t least, std::uint64_t most) const;
  [[nodiscard]] tl::unexpected<Error> formatted_wrong(fmt::string_view format, fmt::format_args arguments) const;
  [[nodiscard]] std::string path_of(std::string_view name) const;

  const nlohmann::json* value_;        // null: missing
  const JsonField* parent_ = nullptr;  // null: the whole document
  std::string_view name_ = {};         // in an object
  std::size_t index_ = 0;              // in a list
};

/// Reads a text by a function that takes the whole document. Also fails as parse_shallow_json does.
template <class Read>
[[nodiscard]] auto read_json(std::string_view text, const Read& read, int most_levels = std::numeric_limits<int>::max())
    -> std::invoke_result_t<Read, JsonField> {
  SPLATVOL_TRY_ASSIGN(document, parse_shallow_json(text, most_levels));
  return read(JsonField(*document));
}

}  // namespace splatvol
