#include "base/json.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "base/names.h"
#include "base/nesting.h"

namespace splatvol {
nlohmann::json parse_json(std::string_view text) { return nlohmann::json::parse(text); }

nlohmann::ordered_json parse_ordered_json(std::string_view text) { return nlohmann::ordered_json::parse(text); }

// (The library's own hook for checks takes time in proportion to the square of a list's length.)
Result<std::shared_ptr<const nlohmann::json>> parse_shallow_json(std::string_view text, int most_levels) try {
  if (is_nested_deeper(text, most_levels))
    return fail(ErrorCode::invalid_data, "nested deeper than {} levels", most_levels);
  return std::make_shared<const nlohmann::json>(nlohmann::json::parse(text));
} catch (const nlohmann::json::exception& error) {
  return fail(ErrorCode::invalid_data, "not JSON: {}", error.what());
}

std::string json_text(const nlohmann::json& value, int indent) {
  return value.dump(indent, ' ', false, nlohmann::json::error_handler_t::replace);
}

std::string json_text(const nlohmann::ordered_json& value, int indent) {
  return value.dump(indent, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
}

JsonField JsonField::member(std::string_view name) const& {
  if (!is_object()) return {nullptr, this, name, 0};
  const auto found = value_->find(name);
  return {found == value_->end() ? nullptr : &*found, this, name, 0};
}

JsonField JsonField::element(std::size_t index) const& {
  return {index < size() ? &(*value_)[index] : nullptr, this, {}, index};
}

bool JsonField::is_object() const { return value_ && value_->is_object(); }
bool JsonField::is_list() const { return value_ && value_->is_array(); }
bool JsonField::is_null() const { return value_ && value_->is_null(); }

std::size_t JsonField::size() const { return is_list() ? value_->size() : 0; }

Status JsonField::check_names(std::initializer_list<std::string_view> known) const {
  if (!is_object()) return wrong("not an object");
  for (const auto& [name, value] : value_->items()) {
    if (name.starts_with("x-") || std::ranges::find(known, name) != known.end()) continue;
    return fail(ErrorCode::invalid_data, "{}: no such field; the nearest is {} (names of your own begin with x-)",
                path_of(name), path_of(nearest_name(name, {known.begin(), known.size()})));
  }
  return {};
}

Result<double> JsonField::number(double largest) const {
  if (!value_ || !value_->is_number()) return wrong("not a number");
  const double number = value_->get<double>();
  if (!std::isfinite(number)) return wrong("not finite");
  if (std::abs(number) > largest) return wrong("beyond {}", largest);
  return number;
}

Result<double> JsonField::number_or_nan() const {
  return is_null() ? Result<double>(std::numeric_limits<double>::quiet_NaN()) : number();
}

Result<std::uint64_t> JsonField::whole_number(std::uint64_t least, std::uint64_t most) const {
  if (value_ && value_->is_number_unsigned())
    if (const auto number = value_->get<std::uint64_t>(); number >= least && number <= most) return number;
  return wrong("not a whole number from {} to {}", least, most);
}

Result<std::string> JsonField::text() const {
  if (!value_ || !value_->is_string()) return wrong("not a string");
  return value_->get<std::string>();
}

Result<bool> JsonField::truth() const {
  if (!value_ || !value_->is_boolean()) return wrong("neither true nor false");
  return value_->get<bool>();
}

Result<std::vector<double>> JsonField::numbers(std::size_t count, double largest) const {
  if (!is_list() || size() != count) return wrong("not a list of {} numbers", count);
  return each([&](const JsonField& number) { return number.number(largest); });
}

std::string JsonField::json() const { return json_text(*value_); }

tl::unexpected<Error> JsonField::formatted_wrong(fmt::string_view format, fmt::format_args arguments) const {
  if (!value_ && !parent_->value_) return parent_->wrong("missing");
  if (!value_ && name_.data() && !parent_->is_object()) return parent_->wrong("not an object");
  const std::string where = path();
  return fail(ErrorCode::invalid_data, "{}{}{}", where, where.empty() ? "" : ": ",
              value_ ? fmt::vformat(format, arguments) : "missing");
}

std::string JsonField::path() const {
  if (!parent_) return {};
  return name_.data() ? parent_->path_of(name_) : fmt::format("{}[{}]", parent_->path(), index_);
}

std::string JsonField::path_of(std::string_view name) const {
  const std::string parent = path();
  return parent.empty() ? std::string(name) : fmt::format("{}.{}", parent, name);
}

}  // namespace splatvol
