#include "builder/sources/openfoam/foam_fields.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <span>
#include <utility>

#include "builder/sources/openfoam/foam_dictionary.h"
#include "builder/sources/openfoam/foam_dimensions.h"
#include "builder/sources/openfoam/foam_lists.h"
#include "builder/sources/read_text.h"

namespace splatvol {
namespace {

class FieldReader {
 public:
  FieldReader(const FoamPlace& place, const FoamFieldKind& kind, std::uint64_t count)
      : reader_(place),
        kind_(kind),
        count_(count),
        entries_(reader_, [this](const std::string& key) { return take(key); }) {}

  FoamField read() {
    while (!is_at_end_ && entries_.read_next()) {
    }
    const std::string& name = reader_.stream().name();
    if (!has_values_) throw ReaderError("{}: it has no {}: is it cut off?", name, values_key());
    if (!kind_.is_internal && !has_boundary_ && !is_at_end_)
      throw ReaderError("{}: it has no boundaryField: is it cut off?", name);
    if (factor_ != 1)
      for (double& value : field_.values) value *= factor_;
    if (kind_.is_symmetric) order_as_vtk();
    return std::move(field_);
  }

 private:
  [[nodiscard]] const char* values_key() const { return kind_.is_internal ? "value" : "internalField"; }
  [[nodiscard]] std::size_t components() const { return static_cast<std::size_t>(kind_.components); }

  /// Takes what the field needs, and passes the others on.
  bool take(const std::string& key) {
    if (key == "dimensions") {
      read_unit();
    } else if (key == values_key() && !reader_.peek().is('{')) {
      if (has_values_) reader_.fail("{} is there twice", key);
      has_values_ = true;
      read_values();
      entries_.ignore_directives();
    } else if (key == "boundaryField") {
      has_boundary_ = true;
      reader_.follow_includes(false);
      reader_.expect('{');
      is_at_end_ = !reader_.skip_block();
      reader_.follow_includes(true);
    } else {
      return false;
    }
    return true;
  }

  static std::string text_of(std::span<const FoamToken> words) {
    std::string text;
    for (const FoamToken& word : words) text += (text.empty() ? "" : " ") + word.text;
    return text;
  }

  void read_unit() {
    const std::vector<FoamToken> words = entries_.read_plain_words();
    const std::string text = text_of(words);
    const std::size_t open = text.find('['), close = text.find(']');
    if (open == std::string::npos || close == std::string::npos || close < open)
      reader_.fail("the dimensions \"{}\" have no square brackets", text.substr(0, 80));
    const auto dimensions = read_dimensions(std::string_view(text).substr(open + 1, close - open - 1));
    // A field's own dimensions have no factor.
    if (dimensions && dimensions->factor == 1) field_.unit = unit_of(*dimensions);
  }

  void read_values() {
    if (!reader_.peek().is_word("nonuniform")) return read_uniform(entries_.read_plain_words());
    reader_.next();
    // The numbers may be binary: no word is read too far.
    std::vector<FoamToken> unit;
    reader_.skip_space();
    while (reader_.stream().peek() == '[' || (!unit.empty() && !unit.back().text.ends_with(']'))) {
      unit.push_back(reader_.next());
      if (unit.back().kind == FoamToken::Kind::end) reader_.expect(']');  // throws
      reader_.skip_space();
    }
    if (reader_.stream().ahead(5) == "List<") reader_.next();
    field_.values = read_numbers(reader_, components(), count_);
    for (const FoamToken& word : entries_.read_plain_words()) unit.push_back(word);
    read_factor(unit);
  }

  void read_uniform(std::vector<FoamToken> words) {
    if (!words.empty() && words.front().is_word("uniform")) words.erase(words.begin());
    std::vector<FoamToken> unit;
    std::vector<double> value;
    for (const FoamToken& word : words) {
      const bool in_unit = word.is('[') || (!unit.empty() && !unit.back().text.ends_with(']'));
      if (in_unit) {
        unit.push_back(word);
      } else if (const auto number = foam_number(word.text)) {
        value.push_back(*number);
      } else if (!word.is('(') && !word.is(')')) {
        reader_.fail("a number must stand there, and not \"{}\"", word.text.substr(0, 40));
      }
    }
    if (value.size() != components())
      reader_.fail("the field has {} components, and its value {}", components(), value.size());
    read_factor(unit);
    field_.values.reserve(count_ * components());
    for (std::uint64_t i = 0; i < count_; ++i) field_.values.insert(field_.values.end(), value.begin(), value.end());
  }

  /// Reads the unit of the values; none: it is that of the field.
  void read_factor(std::span<const FoamToken> words) {
    if (words.empty()) return;
    const std::string text = text_of(words);
    const bool in_brackets = text.starts_with('[') && text.find(']') == text.size() - 1;
    const auto unit = in_brackets ? read_dimensions(std::string_view(text).substr(1, text.size() - 2)) : std::nullopt;
    if (!unit) reader_.fail("the unit \"{}\" of the values is not known", text.substr(0, 80));
    factor_ = unit->factor;
  }

  /// Swaps XY, XZ, YY, YZ, ZZ for VTK's order.
  void order_as_vtk() {
    constexpr std::array<std::size_t, 6> order = {0, 3, 5, 1, 4, 2};
    for (std::size_t at = 0; at + order.size() <= field_.values.size(); at += order.size()) {
      std::array<double, order.size()> tensor;
      for (std::size_t c = 0; c < order.size(); ++c) tensor[c] = field_.values[at + order[c]];
      std::ranges::copy(tensor, field_.values.begin() + static_cast<std::ptrdiff_t>(at));
    }
  }

  FoamReader reader_;
  FoamFieldKind kind_;
  std::uint64_t count_;
  FoamEntries entries_;
  FoamField field_;
  double factor_ = 1;
  bool has_values_ = false, has_boundary_ = false;
  bool is_at_end_ = false;  // the rest cannot be read
};

}  // namespace

std::optional<FoamFieldKind> foam_field_kind(std::string_view class_name) {
  FoamFieldKind kind;
  for (const std::string_view end : {"::Internal", ":Internal"})
    if (class_name.ends_with(end)) {
      class_name.remove_suffix(end.size());
      kind.is_internal = true;
      break;
    }
  kind.of_cells = class_name.starts_with("vol");
  if (!kind.of_cells && !class_name.starts_with("point")) return std::nullopt;
  class_name.remove_prefix(kind.of_cells ? 3 : 5);
  if (is_one_of(class_name, {"ScalarField", "SphericalTensorField"})) return kind;
  kind.is_symmetric = class_name == "SymmTensorField";
  kind.components = class_name == "VectorField" ? 3 : kind.is_symmetric ? 6 : class_name == "TensorField" ? 9 : 0;
  return kind.components > 0 ? std::optional(kind) : std::nullopt;
}

FoamField read_foam_field(const FoamPlace& place, const FoamFieldKind& kind, std::uint64_t count) {
  return FieldReader(place, kind, count).read();
}

}  // namespace splatvol
