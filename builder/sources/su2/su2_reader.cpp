#include "builder/sources/su2/su2_reader.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <map>
#include <string_view>
#include <utility>

#include "builder/sources/csv/csv_source.h"
#include "builder/sources/loaded_data_sets.h"
#include "builder/sources/mesh_data.h"
#include "builder/sources/patch.h"
#include "builder/sources/read_text.h"

namespace splatvol {
namespace {

/// A face of a marker: a triangle, or a quadrilateral.
struct Su2Face {
  int vtk_type;
  std::array<std::uint64_t, 4> nodes;
};

struct Su2Mesh {
  MeshData data;
  std::map<std::string, std::vector<Su2Face>> markers;  // by their names
};

/// SU2 uses VTK's numbers and orders.
constexpr std::size_t corners_of(int vtk_type) {
  switch (vtk_type) {
    case 10:
      return 4;
    case 12:
      return 8;
    case 13:
      return 6;
    case 14:
      return 5;
    default:
      return 0;
  }
}

constexpr std::size_t corners_of_face(int vtk_type) { return vtk_type == 5 ? 3 : vtk_type == 9 ? 4 : 0; }

/// Numbers of a line.
class Words {
 public:
  explicit Words(std::string_view line) : line_(line) {}

  template <class T>
  bool next(T& value) {
    while (!line_.empty() && (is_white_space(line_.front()) || line_.front() == '+')) line_.remove_prefix(1);
    const auto [end, error] = std::from_chars(line_.data(), line_.data() + line_.size(), value);
    if (error != std::errc{}) return false;
    line_.remove_prefix(static_cast<std::size_t>(end - line_.data()));
    return line_.empty() || is_white_space(line_.front());
  }

  [[nodiscard]] bool at_end() const { return line_.empty(); }

 private:
  std::string_view line_;
};

class Su2Reader {
 public:
  /// `markers`: they are wanted.
  Su2Reader(const std::string& path, std::string_view text, bool markers)
      : path_(path), text_(without_byte_order_mark(text)), wants_markers_(markers) {}

  Result<Su2Mesh> read() {
    std::string_view line;
    while (next_line(line)) {
      const std::size_t equals = line.find('=');
      const std::string_view key = trimmed(line.substr(0, equals));
      if (equals != std::string_view::npos)
        SPLATVOL_TRY(read_entry(key, line.substr(equals + 1)));
      else if (!is_left_out_)
        return fail_line("outside of a list");
    }
    if (dimension_ != 3)
      return fail(ErrorCode::unsupported, "{}: a mesh of {} dimensions; splatvol draws volumes", path_, dimension_);
    if (!has_points_ || !has_cells_)
      return fail(ErrorCode::invalid_data, "{}: {} is missing: cut off, or not an SU2 mesh", path_,
                  has_points_ ? "NELEM" : "NPOIN");
    for (const std::int64_t node : mesh_.data.connectivity)
      if (static_cast<std::uint64_t>(node) >= mesh_.data.points.size())
        return fail(ErrorCode::invalid_data, "{}: a cell names point {} of {}", path_, static_cast<std::uint64_t>(node),
                    mesh_.data.points.size());
    SPLATVOL_TRY(check_markers());
    return std::move(mesh_);
  }

 private:
  /// Moves to the next line that is not empty, without its comment.
  bool next_line(std::string_view& line) {
    while (!text_.empty()) {
      ended_ = text_.find('\n') == std::string_view::npos;
      line = take_line(text_);
      line = trimmed(line.substr(0, line.find('%')));
      ++line_;
      if (!line.empty()) return true;
    }
    return false;
  }

  [[nodiscard]] tl::unexpected<Error> fail_line(const char* what) const {
    return fail(ErrorCode::invalid_data, "{}: line {} is damaged, cut off or {}", path_, line_, what);
  }

  [[nodiscard]] tl::unexpected<Error> fail_open_end() const {
    return fail(ErrorCode::invalid_data,
                "{}: no line end follows its last number: the file may be cut off; if it is whole, add a line end",
                path_);
  }

  /// Fails if the file ends right behind the last number that a line needs. An index may follow, cut off or not.
  [[nodiscard]] Status check_end(const Words& numbers) const {
    return ended_ && numbers.at_end() ? Status(fail_open_end()) : Status{};
  }

  Status read_entry(std::string_view key, std::string_view value) {
    Words words(value);
    is_left_out_ = !is_one_of(
        key, {"NZONE", "IZONE", "NDIME", "NELEM", "NPOIN", "NMARK", "MARKER_TAG", "MARKER_ELEMS", "NCORNERS"});
    if (key == "NZONE") {
      int zones = 0;
      if (!words.next(zones) || zones != 1)
        return fail(ErrorCode::unsupported, "{}: several zones: give each zone a file of its own", path_);
    }
    if (key == "NDIME" && !words.next(dimension_)) return fail_line("no number");
    if (key == "NELEM") return read_cells(words);
    if (key == "NPOIN") return read_points(words);
    if (wants_markers_ && key == "NMARK" && !words.next(markers_)) return fail_line("no number");
    if (key == "MARKER_TAG") return read_tag(value);
    if (key == "MARKER_ELEMS" && tag_ == "SEND_RECEIVE") {  // points that processes exchange; SEND_RECV stands before
      is_left_out_ = true;
      ++markers_read_;
      tag_.clear();
      return {};
    }
    if (wants_markers_ && key == "MARKER_ELEMS") return read_marker(words);
    if (key == "MARKER_ELEMS" || key == "NCORNERS") return skip_lines(words);
    return {};
  }

  /// Calls read(numbers of a line, its number) for the lines of a list; each has 2 bytes at least.
  template <class Read>
  Status read_list(Words& words, const Read& read) {
    std::uint64_t count = 0;
    if (!words.next(count) || count > text_.size() / 2) return fail_line("no list");
    std::string_view line;
    for (std::uint64_t i = 0; i < count; ++i) {
      if (!next_line(line) || line.find('=') != std::string_view::npos) return fail_line("too short a list");
      Words numbers(line);
      SPLATVOL_TRY(read(numbers, i));
    }
    return {};
  }

  Status skip_lines(Words& words) {
    return read_list(words, [](Words&, std::uint64_t) { return Status(); });
  }

  Status read_tag(std::string_view tag) {
    tag_ = trimmed(tag);
    if (wants_markers_ && tag_.empty()) return fail_line("a marker without a name");
    return {};
  }

  /// Reads the faces of the marker that was named last. Nodes and lines, which other lists have, are no faces.
  Status read_marker(Words& words) {
    if (tag_.empty()) return fail_line("a marker without a name");
    std::vector<Su2Face>& faces = mesh_.markers[std::exchange(tag_, {})];
    ++markers_read_;
    return read_list(words, [&](Words& numbers, std::uint64_t) -> Status {
      Su2Face face{};
      if (!numbers.next(face.vtk_type)) return fail_line("no face");
      for (std::size_t c = 0; c < corners_of_face(face.vtk_type); ++c)
        if (!numbers.next(face.nodes[c])) return fail_line("no face");
      SPLATVOL_TRY(check_end(numbers));
      if (corners_of_face(face.vtk_type) > 0) faces.push_back(face);
      return {};
    });
  }

  [[nodiscard]] Status check_markers() const {
    if (markers_read_ < markers_)
      return fail(ErrorCode::invalid_data, "{}: cut off: {} of its {} markers are there", path_, markers_read_,
                  markers_);
    for (const auto& [name, faces] : mesh_.markers)
      for (const Su2Face& face : faces)
        for (std::size_t c = 0; c < corners_of_face(face.vtk_type); ++c)
          if (face.nodes[c] >= mesh_.data.points.size())
            return fail(ErrorCode::invalid_data, "{}: the marker \"{}\" names point {} of {}", path_, name,
                        face.nodes[c], mesh_.data.points.size());
    return {};
  }

  Status read_cells(Words& words) {
    has_cells_ = true;
    return read_list(words, [&](Words& numbers, std::uint64_t) -> Status {
      int type = 0;
      if (!numbers.next(type)) return fail_line("no cell");
      const std::size_t corners = corners_of(type);
      if (corners == 0 && dimension_ == 3)
        return fail(ErrorCode::unsupported, "{}: line {}: a cell of type {}, which has no volume or is not known",
                    path_, line_, type);
      std::array<std::uint64_t, 8> nodes{};
      for (std::size_t c = 0; c < corners; ++c)
        if (!numbers.next(nodes[c])) return fail_line("no cell");
      SPLATVOL_TRY(check_end(numbers));
      mesh_.data.add_cell(type, std::span(nodes).first(corners));
      return {};
    });
  }

  Status read_points(Words& words) {
    has_points_ = true;
    return read_list(words, [&](Words& numbers, std::uint64_t i) -> Status {
      dvec3 point(0);
      for (int axis = 0; axis < std::min(dimension_, 3); ++axis)
        if (!numbers.next(point[axis])) return fail_line("no point");
      // A line that ends with the file may be cut off, unless the index of the point follows.
      std::uint64_t index = 0;
      if (ended_ && (!numbers.next(index) || index != i)) return fail_open_end();
      mesh_.data.points.push_back(point);
      return {};
    });
  }

  const std::string& path_;
  std::string_view text_;  // that is not read yet
  std::uint64_t line_ = 0;
  bool ended_ = false;        // the file, in the current line
  bool is_left_out_ = false;  // the entry that was read last, with its lines: boxes to deform a mesh, periods
  int dimension_ = 0;
  bool has_points_ = false;
  bool has_cells_ = false;
  bool wants_markers_;
  std::uint64_t markers_ = 0;  // that the file declares
  std::uint64_t markers_read_ = 0;
  std::string tag_;  // of the marker that comes next
  Su2Mesh mesh_;
};

/// Markers without faces are no patches.
std::vector<Patch> make_patches(const Su2Mesh& mesh) {
  std::vector<Patch> patches;
  for (const auto& [name, faces] : mesh.markers) {
    if (faces.empty()) continue;
    std::vector<SurfaceCell> cells;
    for (const Su2Face& face : faces) {
      SurfaceCell& cell = cells.emplace_back(SurfaceCell{face.vtk_type, {}});
      for (std::size_t c = 0; c < corners_of_face(face.vtk_type); ++c)
        cell.points.push_back(static_cast<std::uint32_t>(face.nodes[c]));
    }
    append_cells_of(mesh.data.points, std::move(cells), patches.emplace_back(Patch{name, {}}).mesh);
  }
  return patches;
}

/// The largest distance of a position that was written with seven digits from the original.
double tolerance_of(const std::vector<dvec3>& points) {
  double largest = 0;
  for (const dvec3& p : points) largest = std::max({largest, std::abs(p.x), std::abs(p.y), std::abs(p.z)});
  return 1e-5 * largest;
}

/// Adds the values of a .csv file to the points. Returns the counts of its pieces.
Result<CellCensus> add_values(const InputFile& file, const std::vector<std::string>& selection, MeshData& mesh) {
  CellCensus census;
  SourceOptions options{.selection = selection};
  SPLATVOL_TRY_ASSIGN(source, open_csv_files({file.values}, options));
  const std::vector<std::string> names = source->attributes(), units = source->units();
  for (std::size_t a = 0; a < names.size(); ++a)
    mesh.arrays.push_back({{names[a], 1, false, units[a]}, std::vector<double>(mesh.points.size())});
  const double tolerance = tolerance_of(mesh.points);
  std::size_t at = 0;
  for (;;) {
    SPLATVOL_TRY_ASSIGN(piece, source->next());
    if (!piece) break;
    census += piece->census;
    for (std::size_t i = 0; i < piece->points.size(); ++i, ++at) {
      const bool same = at < mesh.points.size() && glm::distance(piece->points[i], mesh.points[at]) <= tolerance;
      if (!same)
        return fail(ErrorCode::invalid_data, "{}: its values are not those of the points of {} (point {})", file.values,
                    file.path, at);
      for (std::size_t a = 0; a < names.size(); ++a) mesh.arrays[a].second[at] = piece->values[a][i];
    }
  }
  if (at != mesh.points.size())
    return fail(ErrorCode::invalid_data, "{}: values of {} points instead of the {} of {}", file.values, at,
                mesh.points.size(), file.path);
  return census;
}

}  // namespace

Result<std::unique_ptr<DataSets>> open_su2(const InputFile& file, const SourceOptions& options) {
  SPLATVOL_TRY_ASSIGN(text, read_text(file.path));
  SPLATVOL_TRY_ASSIGN(mesh, Su2Reader(file.path, text, file.patches).read());
  Result<CellCensus> added;
  if (!file.values.empty()) SPLATVOL_TRY_SET(added, add_values(file, options.selection, mesh.data));
  std::vector<Patch> patches = make_patches(mesh);
  std::vector<std::unique_ptr<DataSet>> data;
  data.push_back(std::make_unique<MeshDataSet>(std::move(mesh.data)));
  auto data_sets =
      std::make_unique<LoadedDataSets>(file.path, std::move(data), std::nullopt, std::move(patches), std::move(*added));
  SPLATVOL_TRY_ASSIGN(arrays, list_su2_arrays(file));
  data_sets->declare(std::move(arrays[0]));
  return data_sets;
}

Result<ArraysOfParts> list_su2_arrays(const InputFile& file) {
  ArraysOfParts arrays(1);
  if (!file.values.empty()) SPLATVOL_TRY_SET(arrays[0], list_csv_arrays({file.values}, {}));
  return arrays;
}

}  // namespace splatvol
