#include "extractor/contour_extraction.h"

#include <algorithm>
#include <limits>
#include <type_traits>
#include <unordered_map>

#include "extractor/last_boxes.h"
#include "sampler/cell_tetrahedra.h"
#include "sampler/contour.h"

namespace splatvol {
namespace {

constexpr std::uint64_t most_held_bytes = std::uint64_t{128} << 20;  // of parts of the file
constexpr std::uint64_t open_vertex_bytes = 96;                      // with its place in the table and the list

bool meets(const Box& box, const Box& other) { return squared_distance(box, other) == 0; }

struct HashOfKey {
  std::size_t operator()(const ContourKey& key) const {
    return (key.low * 0x9e3779b97f4a7c15u) ^ (key.high * 0xc2b2ae3d27d4eb4fu);
  }
};

// Numbers the vertices of parts that follow each other. Holds those that a part to come may have.
class VertexNumbers {
 public:
  explicit VertexNumbers(std::uint64_t memory) : most_open_(memory / open_vertex_bytes) {}

  // `last`: [vertex]: the last part that may have it. Returns the number of each vertex of a part: new ones have the
  // next numbers, and their indices go to `added`.
  Result<std::vector<std::uint64_t>> number(std::size_t part, const std::vector<ContourKey>& keys,
                                            std::span<const std::size_t> last, std::vector<std::uint32_t>& added) {
    std::vector<std::uint64_t> numbers;
    for (std::uint32_t vertex = 0; vertex < keys.size(); ++vertex) {
      const auto found = open_.find(keys[vertex]);
      numbers.push_back(found == open_.end() ? next_++ : found->second);
      if (found != open_.end()) continue;
      added.push_back(vertex);
      if (last[vertex] <= part) continue;
      open_.emplace(keys[vertex], numbers.back());
      ends_[last[vertex]].push_back(keys[vertex]);
    }
    if (const auto ended = ends_.find(part); ended != ends_.end()) {
      for (const ContourKey& key : ended->second) open_.erase(key);
      ends_.erase(ended);
    }
    if (open_.size() > most_open_)
      return fail(ErrorCode::out_of_budget,
                  "the contour has {} vertices between chunks of cells that were read and others: more --memory, or a "
                  ".stl file, which needs none",
                  open_.size());
    return numbers;
  }

  [[nodiscard]] std::uint64_t count() const { return next_; }

 private:
  std::uint64_t most_open_, next_ = 0;
  std::unordered_map<ContourKey, std::uint64_t, HashOfKey> open_;
  std::unordered_map<std::size_t, std::vector<ContourKey>> ends_;  // [part]: open until then
};

class Writer {
 public:
  Writer(const CellTetrahedra& cells, const format::SplatSelection& selection, double value, std::uint64_t memory,
         SurfaceOutput& output, const std::function<void(double)>& progress)
      : cells_(cells),
        selection_(selection),
        value_(value),
        output_(output),
        progress_(progress),
        middle_(middle_of(cells.reader().volume().info().cube)),
        measure_(middle_),
        numbers_(memory),
        arrays_(output_arrays(cells.reader().volume().info(), selection)) {}

  Result<ContourExtractionReport> run() {
    const format::Attribute& attribute = cells_.reader().volume().info().attributes[selection_.attributes[0]];
    const auto shows = [&](const format::CellPage& page, std::size_t chunk) {
      const format::ValueSummary& summary = page.summaries[chunk];
      return attribute.value(double{summary.min}) < value_ && attribute.value(double{summary.max}) >= value_;
    };
    SPLATVOL_TRY_ASSIGN(chunks, cells_.chunks([&](const Box& box) { return meets(box, selection_.box); }, shows));
    std::vector<Box> boxes;
    for (const format::CellChunkEntry& entry : chunks) {
      // A vertex is between points in the box, up to rounding.
      Box& box = boxes.emplace_back(box_of_cells(entry));
      box.low -= cells_.rounding();
      box.high += cells_.rounding();
    }
    const LastBoxes last(boxes);
    SPLATVOL_TRY(cells_.for_each<Part>(
        chunks,
        [&](const format::CellChunkEntry& entry, Tetrahedra& tetrahedra, Part& part) -> Status {
          make(static_cast<std::size_t>(&entry - chunks.data()), tetrahedra, last, part);
          return {};
        },
        [&](const format::CellChunkEntry& entry, const Part& part) -> Status {
          const auto number = static_cast<std::size_t>(&entry - chunks.data());
          progress_(static_cast<double>(number + 1) / static_cast<double>(chunks.size()));
          return write(number, part);
        }));
    report_.triangles = output_.triangles();
    if (report_.triangles == 0)
      return fail(ErrorCode::invalid_argument, "{}: \"{}\" has values from {} to {}, and nowhere {}{}",
                  cells_.reader().volume().name(), selection_.names[0], attribute.min, attribute.max, value_,
                  selection_.box == format::SplatSelection().box ? "" : " in the box");
    report_.vertices = numbers_.count();
    report_.left_out = cells_.unknown_cells();
    report_.area = measure_.area();
    report_.closed = measure_.is_closed();
    report_.volume = measure_.volume();
    return report_;
  }

 private:
  struct Part {
    ContourPart contour;
    ContourMeasure measure{dvec3(0)};
    std::vector<std::size_t> last;  // [vertex]: number of the last chunk that may have it
  };

  static dvec3 middle_of(const Cube& cube) { return cube.origin + 0.5 * cube.edge; }

  void make(std::size_t number, Tetrahedra& tetrahedra, const LastBoxes& last, Part& part) const {
    if (selection_.box != format::SplatSelection().box)
      std::erase_if(tetrahedra.corners, [&](const std::array<std::uint32_t, 4>& corners) {
        Box box;
        for (const std::uint32_t corner : corners) box.include(tetrahedra.points[corner]);
        return !meets(box, selection_.box);
      });
    part.contour = contour_of(tetrahedra, tetrahedra.values[0], value_);
    part.measure = ContourMeasure(middle_);
    part.measure.add(part.contour);
    if (!output_.has_vertices()) return;
    for (const dvec3& point : part.contour.points) part.last.push_back(last.last_above(number, point));
  }

  Status write(std::size_t number, const Part& part) {
    const ContourPart& contour = part.contour;
    measure_.add(part.measure);
    if (!output_.has_vertices()) {
      std::vector<std::array<dvec3, 3>> corners;
      for (std::size_t t = 0; t < contour.triangles.size(); ++t) corners.push_back(contour.corners_of(t));
      return output_.write({.corners = corners});
    }
    std::vector<std::uint32_t> added;
    SPLATVOL_TRY_ASSIGN(numbers, numbers_.number(number, contour.keys, part.last, added));
    std::vector<std::array<std::uint64_t, 3>> triangles;
    for (const auto& [a, b, c] : contour.triangles) triangles.push_back({numbers[a], numbers[b], numbers[c]});
    const auto chosen = [&](const auto& all) {
      std::remove_cvref_t<decltype(all)> some;
      for (const std::uint32_t vertex : added) some.push_back(all[vertex]);
      return some;
    };
    const std::vector<dvec3> points = chosen(contour.points);
    std::vector<std::vector<double>> values, joined(arrays_.size());
    for (const std::vector<double>& of_attribute : contour.values) values.push_back(chosen(of_attribute));
    SurfacePart written = {.points = points, .triangles = triangles};
    for (std::size_t a = 0; a < arrays_.size(); ++a)
      written.values.push_back(numbers_of(arrays_[a], values, joined[a]));
    return output_.write(written);
  }

  const CellTetrahedra& cells_;
  const format::SplatSelection& selection_;
  double value_;
  SurfaceOutput& output_;
  const std::function<void(double)>& progress_;
  dvec3 middle_;
  ContourMeasure measure_;
  VertexNumbers numbers_;
  std::vector<OutputArray> arrays_;
  ContourExtractionReport report_;
};

// Arrays in memory.
class MemoryOutput final : public SurfaceOutput {
 public:
  explicit MemoryOutput(std::span<const OutputArray> arrays) {
    for (const OutputArray& array : arrays)
      mesh_.point_values.push_back({array.name, array.unit, array.components(), {}});
  }

  Status write(const SurfacePart& part) override {
    triangles_ += part.triangles.size();
    mesh_.points.insert(mesh_.points.end(), part.points.begin(), part.points.end());
    for (std::size_t a = 0; a < part.values.size(); ++a) {
      std::vector<double>& numbers = mesh_.point_values[a].numbers;
      numbers.insert(numbers.end(), part.values[a].begin(), part.values[a].end());
    }
    for (const auto& [a, b, c] : part.triangles)
      mesh_.triangles.push_back(
          {static_cast<std::int64_t>(a), static_cast<std::int64_t>(b), static_cast<std::int64_t>(c)});
    return {};
  }

  ContourMesh take(const ContourExtractionReport& report) {
    mesh_.left_out = report.left_out;
    return std::move(mesh_);
  }

 private:
  ContourMesh mesh_;
};

}  // namespace

Result<ContourExtractionReport> extract_contour(const format::Volume& volume, const format::SplatSelection& selection,
                                                double value, std::uint64_t memory, SurfaceOutput& output,
                                                const std::function<void(double)>& progress) {
  SPLATVOL_TRY_ASSIGN(
      cells, CellTetrahedra::open(volume, selection.attributes, own_room(std::min(memory / 2, most_held_bytes)),
                                  {.values = static_cast<int>(selection.attributes[0])}));
  if (!cells) return fail_without_cells(volume);
  if (cells->has_constant())
    return fail(ErrorCode::unsupported,
                "{}: its cells have values of their own, which jump between them: no surface has a value",
                volume.name());
  return Writer(*cells, selection, value, memory / 2, output, progress).run();
}

Result<ContourMesh> extract_contour(const format::Volume& volume, const format::SplatSelection& selection,
                                    double value) {
  // All vertices are in memory anyway.
  constexpr std::uint64_t memory = std::numeric_limits<std::uint64_t>::max();
  MemoryOutput output(output_arrays(volume.info(), selection));
  SPLATVOL_TRY_ASSIGN(report, extract_contour(volume, selection, value, memory, output, [](double) {}));
  return output.take(report);
}

}  // namespace splatvol
