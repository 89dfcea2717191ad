#include "builder/sources/gmsh/gmsh_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <map>
#include <span>
#include <string_view>
#include <tuple>
#include <utility>

#include "base/printable.h"
#include "builder/sources/read_text.h"

namespace splatvol {
namespace {

/// Reads numbers, as text or as bytes. A number that is not there sets a failure, and reads as 0.
class Scanner {
 public:
  explicit Scanner(std::string_view bytes) : bytes_(without_byte_order_mark(bytes)) {}

  void set_binary(bool binary) { binary_ = binary; }
  [[nodiscard]] bool binary() const { return binary_; }
  [[nodiscard]] bool failed() const { return failed_; }
  [[nodiscard]] std::size_t left() const { return bytes_.size() - at_; }

  /// The first integer that is too large for its kind, which sets a failure; empty: there was none.
  [[nodiscard]] const std::string& too_large() const { return too_large_; }
  void fail() { failed_ = true; }

  /// Reads a number of the file's kind.
  template <class T>
  T number() {
    return binary_ ? raw<T>() : text<T>();
  }

  template <class T>
  T text() {
    skip_space();
    T value{};
    if (at_ < bytes_.size() && bytes_[at_] == '+') ++at_;
    const char* first = bytes_.data() + at_;
    const auto [end, error] = std::from_chars(first, bytes_.data() + bytes_.size(), value);
    // A number at the very end of the file may be cut off.
    failed_ = failed_ || error == std::errc::invalid_argument || end == bytes_.data() + bytes_.size();
    at_ += static_cast<std::size_t>(end - first);
    if (error == std::errc::result_out_of_range) take_out_of_range(std::string(first, end), value);
    return value;
  }

  /// Reads a count of things that take at least `bytes` bytes each. Fails if they cannot be in the file.
  template <class T>
  std::uint64_t count(std::size_t bytes) {
    const T value = number<T>();
    if (value < T{0} || static_cast<std::uint64_t>(value) > left() / bytes) failed_ = true;
    return failed_ ? 0 : static_cast<std::uint64_t>(value);
  }

  /// Returns the rest of the line, and moves behind it.
  std::string_view line() {
    const std::size_t end = std::min(bytes_.find('\n', at_), bytes_.size());
    std::string_view line = bytes_.substr(at_, end - at_);
    at_ = std::min(end + 1, bytes_.size());
    while (!line.empty() && is_white_space(line.back())) line.remove_suffix(1);
    return line;
  }

  /// Reads the name that ends a line. It may stand between quotation marks.
  std::string name() {
    skip_space();
    if (left() == 0) failed_ = true;
    std::string_view name = line();
    if (name.starts_with('"')) {
      if (name.size() < 2 || name.back() != '"') failed_ = true;
      name = name.substr(1, std::max<std::size_t>(name.size(), 2) - 2);
    } else if (name.starts_with('$')) {
      failed_ = true;  // the next section
    }
    return failed_ ? std::string() : std::string(name);
  }

  /// Tells whether a digit comes next, behind spaces.
  bool digit_follows() {
    skip_space();
    return at_ < bytes_.size() && bytes_[at_] >= '0' && bytes_[at_] <= '9';
  }

  /// Moves behind a line "$End" + name; fails if there is none. Spaces may stand before it.
  void end(const std::string& name) {
    skip_space();
    if (line() != "$End" + name) failed_ = true;
  }

  /// Moves behind the next line "$End" + name, whatever is before it.
  void skip_section(const std::string& name) {
    const std::size_t found = bytes_.find("$End" + name, at_);
    failed_ = failed_ || found == std::string_view::npos;
    if (failed_) return;
    at_ = found;
    line();
  }

 private:
  /// A real number beyond all others is infinite or 0, as its text says.
  template <class T>
  void take_out_of_range(const std::string& word, T& value) {
    if constexpr (std::is_floating_point_v<T>) {
      value = std::strtod(word.c_str(), nullptr);
    } else {
      if (too_large_.empty()) too_large_ = word;
      failed_ = true;
    }
  }

  template <class T>
  T raw() {
    T value{};
    if (left() < sizeof(T)) {
      failed_ = true;
      return value;
    }
    std::memcpy(&value, bytes_.data() + at_, sizeof(T));
    at_ += sizeof(T);
    return value;
  }

  void skip_space() {
    while (at_ < bytes_.size() && is_white_space(bytes_[at_])) ++at_;
  }

  std::string_view bytes_;
  std::size_t at_ = 0;
  bool binary_ = false;
  bool failed_ = false;
  std::string too_large_;
};

struct NodeCount {
  int type;
  std::size_t nodes;
};
constexpr std::array<NodeCount, 36> node_counts = {
    {{1, 2},   {2, 3},   {3, 4},   {4, 4},   {5, 8},   {6, 6},   {7, 5},   {8, 3},   {9, 6},
     {10, 9},  {11, 10}, {12, 27}, {13, 18}, {14, 14}, {15, 1},  {16, 8},  {17, 20}, {18, 15},
     {19, 13}, {20, 9},  {21, 10}, {22, 12}, {23, 15}, {24, 15}, {25, 21}, {26, 4},  {27, 5},
     {28, 6},  {29, 20}, {30, 35}, {31, 56}, {36, 16}, {37, 25}, {38, 36}, {92, 64}, {93, 125}}};

constexpr bool is_surface(int type) {
  return type == 2 || type == 3 || type == 9 || type == 10 || type == 16 || (type >= 20 && type <= 25) ||
         (type >= 36 && type <= 38);
}

/// Bounds the memory: every face of a surface is in each of its groups.
constexpr std::uint64_t most_groups = 64;

/// Reads the sections of a file.
class GmshReader {
 public:
  /// `groups`: the physical groups are wanted. `headers_only`: nothing but the headers of views is.
  GmshReader(const std::string& path, std::string_view bytes, bool groups, bool headers_only = false)
      : path_(path), in_(bytes), wants_groups_(groups), headers_only_(headers_only) {}

  Result<GmshFile> read() {
    SPLATVOL_TRY(read_format());
    while (in_.left() > 0) {
      const std::string_view line = in_.line();
      if (is_comment(line)) continue;
      if (!line.starts_with('$'))
        return fail(ErrorCode::invalid_data, "{}: a line stands outside of the sections: damaged", path_);
      const std::string section = name_of_section(line);
      SPLATVOL_TRY(read_section(section));
      if (!in_.too_large().empty())
        return fail(ErrorCode::unsupported,
                    "{}: the number {} in the section ${} is too large: tags of this version are below 2^31, so "
                    "number nodes and elements anew",
                    path_, in_.too_large().substr(0, 40), section.substr(0, 40));
      if (in_.failed())
        return fail(ErrorCode::invalid_data, "{}: the section ${} is damaged or cut off", path_, section.substr(0, 40));
    }
    SPLATVOL_TRY(check_views());
    tell_steps_apart();
    name_groups();
    return std::move(file_);
  }

 private:
  /// Empty lines count as comments.
  static bool is_comment(std::string_view line) {
    return line.empty() || std::string_view("#%!*;").find(line.front()) != std::string_view::npos ||
           line.starts_with("//");
  }

  /// Returns the first word of a section's first line, without the "$".
  static std::string name_of_section(std::string_view line) {
    return std::string(line.substr(1, line.find_first_of(" \t") - 1));
  }

  /// Moves behind the line "$MeshFormat". Comments may stand before it, in lines and in sections of other names.
  void find_format() {
    while (in_.left() > 0 && !in_.failed()) {
      const std::string_view line = in_.line();
      if (is_comment(line)) continue;
      if (line == "$MeshFormat") return;
      is_version_1_ = is_version_1_ || line == "$NOD";
      const std::string section = line.starts_with('$') ? name_of_section(line) : "";
      if (section.empty() || section == "Nodes" || section == "Elements" || section.ends_with("Data")) break;
      in_.skip_section(section);
    }
    in_.fail();
  }

  [[nodiscard]] tl::unexpected<Error> fail_version(const std::string& version) const {
    return fail(ErrorCode::unsupported,
                "{}: Gmsh's format {} cannot be read, only 2 to 2.2 and 4.1: gmsh {} -save -format msh41 -o OUT.msh",
                path_, version, path_);
  }

  Status read_format() {
    find_format();
    if (is_version_1_) return fail_version("1");
    if (in_.failed())
      return fail(ErrorCode::invalid_data, "{}: not a Gmsh file (it does not begin with $MeshFormat)", path_);
    version_ = in_.text<double>();
    const int type = in_.text<int>(), size = in_.text<int>();
    in_.line();
    if (in_.failed() || type < 0 || type > 1) return fail(ErrorCode::invalid_data, "{}: $MeshFormat is damaged", path_);
    is_version_2_ = version_ >= 2 && version_ <= 2.2;
    if (!is_version_2_ && version_ != 4.1) return fail_version(fmt::format("{}", version_));
    if (size != 8) return fail(ErrorCode::unsupported, "{}: numbers of {} bytes instead of 8", path_, size);
    in_.set_binary(type == 1);
    file_.may_repeat = is_version_2_;
    if (type == 1 && in_.number<std::int32_t>() != 1)
      return fail(ErrorCode::unsupported, "{}: written by a machine of the other byte order: save it as ascii", path_);
    in_.end("MeshFormat");
    if (in_.failed()) return fail(ErrorCode::invalid_data, "{}: $MeshFormat is damaged", path_);
    return {};
  }

  Status read_section(const std::string& name) {
    const bool is_view = name.ends_with("Data");
    if (headers_only_ && !is_view) {
      in_.skip_section(name);
      return {};
    }
    if (name == "Nodes") {
      is_version_2_ ? read_nodes_2() : read_nodes_4();
    } else if (name == "Elements") {
      SPLATVOL_TRY(is_version_2_ ? read_elements_2() : read_elements_4());
    } else if (name == "PhysicalNames" && wants_groups_) {
      read_names();
    } else if (name == "Entities") {
      SPLATVOL_TRY(read_entities());
    } else if (name == "NodeData") {
      read_view(GmshView::At::nodes);
    } else if (name == "ElementData") {
      read_view(GmshView::At::elements);
    } else if (name == "ElementNodeData") {
      read_view(GmshView::At::element_nodes);
    } else {
      in_.skip_section(name);
      return {};
    }
    if (headers_only_)
      in_.skip_section(name);
    else if (!in_.failed())
      in_.end(name);
    return {};
  }

  /// Reads the names of physical groups. They are text in binary files too. Format 2.0 gives no dimensions.
  void read_names() {
    const auto count = in_.text<std::uint64_t>();
    for (std::uint64_t i = 0; i < count && !in_.failed(); ++i) {
      auto dimension = std::int64_t{2}, tag = in_.text<std::int64_t>();
      if (version_ > 2 || in_.digit_follows()) {
        dimension = tag;
        tag = in_.text<std::int64_t>();
      }
      const std::string name = in_.name();
      if (dimension == 2 && !name.empty()) group_names_.try_emplace(tag, name);
    }
  }

  /// Reads the physical groups of surfaces and volumes.
  Status read_entities() {
    std::array<std::uint64_t, 4> counts{};  // [dimension]
    for (std::uint64_t& count : counts) count = in_.count<std::uint64_t>(4);
    for (std::size_t dimension = 0; dimension < counts.size(); ++dimension)
      for (std::uint64_t i = 0; i < counts[dimension] && !in_.failed(); ++i) {
        const int tag = in_.number<int>();
        for (int number = dimension == 0 ? 3 : 6; number > 0; --number) in_.number<double>();  // its box
        std::vector<std::int64_t> groups;
        const std::uint64_t count = in_.count<std::uint64_t>(2);
        // The sign tells which way round the surface is.
        for (std::uint64_t g = 0; g < count && !in_.failed(); ++g)
          groups.push_back(std::abs(std::int64_t{in_.number<int>()}));
        const std::uint64_t borders = dimension == 0 ? 0 : in_.count<std::uint64_t>(2);
        for (std::uint64_t b = 0; b < borders && !in_.failed(); ++b) in_.number<int>();
        if (dimension == 3 && !groups.empty()) material_of_volume_[tag] = static_cast<int>(groups.front());
        if (dimension != 2 || !wants_groups_) continue;
        std::ranges::sort(groups);
        groups.erase(std::ranges::unique(groups).begin(), groups.end());
        if (groups.size() > most_groups)
          return fail(ErrorCode::unsupported, "{}: surface {} is in {} physical groups; {} is the limit", path_, tag,
                      groups.size(), most_groups);
        groups_of_surface_[tag] = std::move(groups);
      }
    return {};
  }

  /// Notes that the last element is in some physical groups.
  void add_to_groups(std::span<const std::int64_t> groups) {
    for (const std::int64_t group : groups) elements_of_group_[group].push_back(file_.elements.types.size() - 1);
  }

  void name_groups() {
    std::map<std::string, std::vector<std::size_t>> by_name;
    for (auto& [tag, elements] : elements_of_group_) {
      const auto name = group_names_.find(tag);
      auto& all = by_name[name == group_names_.end() ? fmt::format("physical surface {}", tag) : name->second];
      all.insert(all.end(), elements.begin(), elements.end());
    }
    for (auto& [name, elements] : by_name) file_.groups.push_back({name, std::move(elements)});
  }

  void read_point() {
    const auto x = in_.number<double>(), y = in_.number<double>(), z = in_.number<double>();
    file_.points.emplace_back(x, y, z);
  }

  void read_nodes_2() {
    const std::uint64_t count = text_count(8);
    for (std::uint64_t i = 0; i < count && !in_.failed(); ++i) {
      file_.node_tags.push_back(static_cast<std::uint64_t>(in_.number<std::int32_t>()));
      read_point();
    }
  }

  /// A count that is text in binary files too; the numbers begin behind its line.
  std::uint64_t text_count(std::size_t bytes) {
    const auto count = in_.text<std::uint64_t>();
    if (in_.binary()) in_.line();
    if (count > in_.left() / bytes) in_.fail();
    return in_.failed() ? 0 : count;
  }

  void read_nodes_4() {
    const std::uint64_t blocks = in_.count<std::uint64_t>(4);
    for (int i = 0; i < 3; ++i) in_.number<std::uint64_t>();  // all nodes, the lowest and the highest tag
    for (std::uint64_t b = 0; b < blocks && !in_.failed(); ++b) {
      const int dimension = in_.number<int>();
      in_.number<int>();
      const int parameters = in_.number<int>() != 0 ? dimension : 0;
      const std::uint64_t count = in_.count<std::uint64_t>(8);
      for (std::uint64_t i = 0; i < count && !in_.failed(); ++i) file_.node_tags.push_back(in_.number<std::uint64_t>());
      for (std::uint64_t i = 0; i < count && !in_.failed(); ++i) {
        read_point();
        for (int p = 0; p < parameters && p < 3; ++p) in_.number<double>();
      }
    }
  }

  Status fail_type(int type) const {
    return fail(ErrorCode::unsupported,
                "{}: elements of Gmsh's type {} cannot be read; lower the order: gmsh {} -order 2 -save -o OUT.msh",
                path_, type, path_);
  }

  template <class Tag>
  void read_element(int type, std::uint64_t tag, std::size_t nodes, int material) {
    file_.elements.types.push_back(type);
    file_.elements.tags.push_back(tag);
    file_.elements.materials.push_back(material);
    for (std::size_t n = 0; n < nodes; ++n)
      file_.elements.nodes.push_back(static_cast<std::uint64_t>(in_.number<Tag>()));
  }

  Status read_elements_2() {
    std::uint64_t left = text_count(6);
    while (left > 0 && !in_.failed()) {
      // Text: number, type, tags, nodes. Bytes: type, number of elements, number of tags, then the elements.
      const std::int32_t first = in_.number<std::int32_t>();
      const std::int32_t second = in_.number<std::int32_t>();
      const std::int32_t tags = in_.number<std::int32_t>();
      const int type = in_.binary() ? first : second;
      const std::uint64_t count = in_.binary() ? static_cast<std::uint32_t>(second) : 1;
      const auto nodes = gmsh_node_count(type);
      if (in_.failed()) break;
      if (!nodes) return fail_type(type);
      if (count == 0 || count > left || tags < 0) in_.fail();
      for (std::uint64_t i = 0; i < count && !in_.failed(); ++i) {
        const std::int32_t tag = in_.binary() ? in_.number<std::int32_t>() : first;
        std::int64_t group = 0;  // the first tag; 0: none
        for (std::int32_t t = 0; t < tags && !in_.failed(); ++t) {
          const auto number = in_.number<std::int32_t>();
          if (t == 0) group = std::abs(std::int64_t{number});
        }
        read_element<std::int32_t>(type, static_cast<std::uint64_t>(tag), *nodes, static_cast<int>(group));
        if (wants_groups_ && group != 0 && is_surface(type)) add_to_groups(std::array{group});
      }
      left -= std::min(count, left);
    }
    return {};
  }

  Status read_elements_4() {
    const std::uint64_t blocks = in_.count<std::uint64_t>(4);
    for (int i = 0; i < 3; ++i) in_.number<std::uint64_t>();
    for (std::uint64_t b = 0; b < blocks && !in_.failed(); ++b) {
      const int dimension = in_.number<int>(), entity = in_.number<int>();
      const int type = in_.number<int>();
      const std::uint64_t count = in_.count<std::uint64_t>(4);
      const auto nodes = gmsh_node_count(type);
      if (in_.failed()) break;
      if (!nodes) return fail_type(type);
      std::span<const std::int64_t> groups;
      if (const auto found = groups_of_surface_.find(entity);
          dimension == 2 && is_surface(type) && found != groups_of_surface_.end())
        groups = found->second;
      const auto material = dimension == 3 ? material_of_volume_.find(entity) : material_of_volume_.end();
      for (std::uint64_t i = 0; i < count && !in_.failed(); ++i) {
        const auto tag = in_.number<std::uint64_t>();
        read_element<std::uint64_t>(type, tag, *nodes, material == material_of_volume_.end() ? 0 : material->second);
        add_to_groups(groups);
      }
    }
    return {};
  }

  /// Reads a view. Its tags are text in binary files too: strings (the name), reals (the time) and integers (the step,
  /// components, the number of nodes or elements).
  void read_view(GmshView::At at) {
    GmshView view;
    view.at = at;
    const auto strings = in_.text<std::uint64_t>();
    in_.line();
    for (std::uint64_t i = 0; i < strings && !in_.failed(); ++i) {
      const std::string text = in_.name();
      if (i == 0) view.name = as_utf8(text);
    }
    const auto reals = in_.text<std::uint64_t>();
    for (std::uint64_t i = 0; i < reals && !in_.failed(); ++i) {
      const auto real = in_.text<double>();
      if (i == 0) view.time = real;
    }
    const auto integers = in_.text<std::uint64_t>();
    std::uint64_t count = 0;
    for (std::uint64_t i = 0; i < integers && !in_.failed(); ++i) {
      const auto integer = in_.text<std::int64_t>();
      if (i == 0) view.step = integer;
      if (i == 1) view.components = static_cast<std::size_t>(integer);
      if (i == 2) count = static_cast<std::uint64_t>(integer);
    }
    if (in_.binary()) in_.line();
    if (!std::isfinite(view.time) || view.components < 1 || view.components > 9 || integers < 3 ||
        count > in_.left() / 4)
      in_.fail();
    for (std::uint64_t i = 0; i < count && !headers_only_ && !in_.failed(); ++i) read_view_values(view);
    const auto [known, is_new] =
        sections_.try_emplace({view.at, view.name, view.components, view.step, view.time}, file_.views.size());
    is_new ? file_.views.push_back(std::move(view)) : append(view, file_.views[known->second]);
  }

  /// Appends a section of a view to the sections before.
  static void append(const GmshView& part, GmshView& view) {
    view.tags.insert(view.tags.end(), part.tags.begin(), part.tags.end());
    view.counts.insert(view.counts.end(), part.counts.begin(), part.counts.end());
    view.values.insert(view.values.end(), part.values.begin(), part.values.end());
  }

  /// Fails if two views have the same name: one that has values twice for a node or element, or of different forms.
  Status check_views() const {
    std::map<std::pair<GmshView::At, std::string_view>, std::size_t> components;
    for (const GmshView& view : file_.views) {
      if (view.name.empty())
        return splatvol::fail(ErrorCode::invalid_data, "{}: a view has no name: give it one", path_);
      std::vector<std::uint64_t> tags = view.tags;
      std::ranges::sort(tags);
      const auto twice = std::ranges::adjacent_find(tags);
      if (twice != tags.end())
        return fail(ErrorCode::invalid_data,
                    "{}: two views are called \"{}\": both have values of {} {} at time {}; rename one", path_,
                    view.name, view.at == GmshView::At::nodes ? "node" : "element", *twice, view.time);
      const auto [known, is_new] = components.try_emplace({view.at, view.name}, view.components);
      if (known->second != view.components)
        return fail(ErrorCode::invalid_data,
                    "{}: two views are called \"{}\": one has {} components, and one {}; rename one", path_, view.name,
                    known->second, view.components);
    }
    return {};
  }

  /// Some programs write the same time for all steps of a view: then their numbers are the times.
  void tell_steps_apart() {
    std::map<std::tuple<GmshView::At, std::string_view, double>, std::int64_t> steps;
    bool told = true;
    for (const GmshView& view : file_.views)
      told = told && steps.try_emplace({view.at, view.name, view.time}, view.step).first->second == view.step;
    if (told) return;
    for (GmshView& view : file_.views) view.time = static_cast<double>(view.step);
  }

  void read_view_values(GmshView& view) {
    view.tags.push_back(static_cast<std::uint64_t>(in_.number<std::int32_t>()));
    std::uint64_t nodes = 1;
    if (view.at == GmshView::At::element_nodes) {
      nodes = in_.count<std::int32_t>(1);
      view.counts.push_back(static_cast<std::uint32_t>(nodes));
    }
    for (std::uint64_t i = 0; i < nodes * view.components && !in_.failed(); ++i)
      view.values.push_back(in_.number<double>());
  }

  const std::string& path_;
  Scanner in_;
  bool wants_groups_, headers_only_;
  double version_ = 0;
  bool is_version_1_ = false;
  bool is_version_2_ = false;                                           // 2.0, 2.1 or 2.2
  std::map<std::int64_t, std::string> group_names_;                     // of surfaces, by their tags
  std::map<std::int64_t, std::vector<std::size_t>> elements_of_group_;  // by the group's tag
  std::map<int, std::vector<std::int64_t>> groups_of_surface_;          // version 4.1: by the surface's tag
  std::map<int, int> material_of_volume_;                               // version 4.1: by the volume's tag
  std::map<std::tuple<GmshView::At, std::string, std::size_t, std::int64_t, double>, std::size_t>
      sections_;  // of views: their indices in file_
  GmshFile file_;
};

}  // namespace

std::optional<std::size_t> gmsh_node_count(int type) {
  const auto* found = std::ranges::find(node_counts, type, &NodeCount::type);
  return found == node_counts.end() ? std::nullopt : std::optional(found->nodes);
}

Result<GmshFile> read_gmsh(const std::string& path, bool groups) {
  SPLATVOL_TRY_ASSIGN(bytes, read_text(path));
  return GmshReader(path, bytes, groups).read();
}

Result<std::vector<GmshView>> read_gmsh_views(const std::string& path) {
  SPLATVOL_TRY_ASSIGN(bytes, read_text(path));
  SPLATVOL_TRY_ASSIGN(gmsh, GmshReader(path, bytes, false, true).read());
  return std::move(gmsh.views);
}

}  // namespace splatvol
