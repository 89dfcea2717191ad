#include "tools/export/surface_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "base/file.h"
#include "base/temp_file.h"
#include "tools/export/vtu_file.h"

namespace splatvol {
namespace {

template <class Number>
Status append_number(AtomicFile& file, Number number) {
  return file.append(std::as_bytes(std::span(&number, 1)));
}

Status append_text(AtomicFile& file, std::string_view text) { return file.append(std::as_bytes(std::span(text))); }

Status append_all(AtomicFile& file, const TempFile& from) {
  std::vector<std::byte> bytes(std::size_t{1} << 20);
  for (std::uint64_t begin = 0; begin < from.size(); begin += bytes.size()) {
    bytes.resize(std::min<std::uint64_t>(bytes.size(), from.size() - begin));
    SPLATVOL_TRY(from.read(begin, bytes));
    SPLATVOL_TRY(file.append(bytes));
  }
  return {};
}

Result<TempFile> temp_file_beside(const std::string& path) { return TempFile::create(folder_of(path)); }

Result<vec3> in_single_precision(const dvec3& point, const std::string& path) {
  const vec3 rounded(point);
  for (int axis = 0; axis < 3; ++axis)
    if (!std::isfinite(rounded[axis]))
      return fail(ErrorCode::unsupported, "{}: a coordinate of {} is too large for single precision: take .vtp", path,
                  point[axis]);
  return rounded;
}

// Header, XML and raw numbers.
class VtpFile final : public SurfaceFile {
 public:
  VtpFile(AtomicFile file, std::vector<TempFile> parts, std::span<const OutputArray> arrays)
      : file_(std::move(file)), parts_(std::move(parts)), arrays_(arrays.begin(), arrays.end()) {}

  Status write(const SurfacePart& part) override {
    triangles_ += part.triangles.size();
    SPLATVOL_TRY(parts_[0].append(std::as_bytes(part.points)));
    SPLATVOL_TRY(parts_[1].append(std::as_bytes(part.triangles)));
    for (std::size_t a = 0; a < arrays_.size(); ++a) SPLATVOL_TRY(parts_[2 + a].append(std::as_bytes(part.values[a])));
    return {};
  }

  Result<std::uint64_t> finish() override {
    SPLATVOL_TRY(append_text(file_, header()));
    for (const TempFile& part : parts_) {
      SPLATVOL_TRY(append_number(file_, part.size()));
      SPLATVOL_TRY(append_all(file_, part));
    }
    SPLATVOL_TRY(append_number(file_, triangles_ * sizeof(std::uint64_t)));
    std::vector<std::uint64_t> ends;
    for (std::uint64_t end = 0; end < triangles_;) {
      ends.resize(std::min<std::uint64_t>(triangles_ - end, std::uint64_t{1} << 17));
      for (std::uint64_t& corner : ends) corner = 3 * ++end;
      SPLATVOL_TRY(file_.append(std::as_bytes(std::span(ends))));
    }
    SPLATVOL_TRY(append_text(file_, "\n  </AppendedData>\n</VTKFile>\n"));
    const std::uint64_t bytes = file_.position();
    SPLATVOL_TRY(file_.commit());
    return bytes;
  }

 private:
  [[nodiscard]] std::string header() const {
    std::uint64_t offset = 0;
    const auto array = [&](const char* type, const std::string& name, std::size_t components, std::uint64_t bytes,
                           const std::string& unit = {}) {
      const VtuArray element{.name = name, .type = type, .components = components, .unit = unit};
      return vtk_array_element(element, std::exchange(offset, offset + sizeof(std::uint64_t) + bytes));
    };
    const std::string points = array("Float64", "Points", 3, parts_[0].size());
    const std::string connectivity = array("Int64", "connectivity", 1, parts_[1].size());
    std::string values;
    for (std::size_t a = 0; a < arrays_.size(); ++a)
      values += array("Float64", arrays_[a].name, arrays_[a].components(), parts_[2 + a].size(), arrays_[a].unit);
    const std::string ends = array("Int64", "offsets", 1, triangles_ * sizeof(std::uint64_t));
    return fmt::format(
        "<?xml version=\"1.0\"?>\n{}\n"
        "<VTKFile type=\"PolyData\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\">\n  <PolyData>\n"
        "    <Piece NumberOfPoints=\"{}\" NumberOfVerts=\"0\" NumberOfLines=\"0\" NumberOfStrips=\"0\" "
        "NumberOfPolys=\"{}\">\n"
        "      <Points>\n{}      </Points>\n      <Polys>\n{}{}      </Polys>\n      <PointData>\n{}"
        "      </PointData>\n    </Piece>\n  </PolyData>\n  <AppendedData encoding=\"raw\">\n   _",
        vtk_export_mark, parts_[0].size() / sizeof(dvec3), triangles_, points, connectivity, ends, values);
  }

  AtomicFile file_;
  std::vector<TempFile> parts_;  // points, connectivity, then the values of each array
  std::vector<OutputArray> arrays_;
};

// 80 bytes, the number of triangles, and 50 bytes for each.
class StlFile final : public SurfaceFile {
 public:
  static Result<std::unique_ptr<SurfaceFile>> begin(AtomicFile file, const std::string& path) {
    std::string head(stl_header_bytes, '\0');
    std::ranges::copy(stl_export_mark, head.begin());
    SPLATVOL_TRY(append_text(file, head));
    SPLATVOL_TRY(append_number(file, std::uint32_t{0}));
    return std::unique_ptr<SurfaceFile>(new StlFile(std::move(file), path));
  }

  [[nodiscard]] bool has_vertices() const override { return false; }

  Status write(const SurfacePart& part) override {
    std::vector<std::byte> bytes;
    for (const std::array<dvec3, 3>& corners : part.corners) {
      std::array<vec3, 4> facet{};  // the normal, then the corners
      for (std::size_t k = 0; k < 3; ++k) SPLATVOL_TRY_SET(facet[k + 1], in_single_precision(corners[k], path_));
      if (facet[1] == facet[2] || facet[2] == facet[3] || facet[3] == facet[1]) continue;
      const dvec3 normal = glm::cross(corners[1] - corners[0], corners[2] - corners[0]);
      const double length = glm::length(normal);
      if (length > 0) facet[0] = vec3(normal / length);
      const auto of_facet = std::as_bytes(std::span(facet));
      bytes.insert(bytes.end(), of_facet.begin(), of_facet.end());
      bytes.resize(bytes.size() + 2);  // its attributes
      ++triangles_;
    }
    if (triangles_ > std::numeric_limits<std::uint32_t>::max())
      return fail(ErrorCode::unsupported, "{}: more triangles than a .stl file can have: take .vtp", path_);
    return file_.append(bytes);
  }

  Result<std::uint64_t> finish() override {
    const auto count = static_cast<std::uint32_t>(triangles_);
    SPLATVOL_TRY(file_.write_at(stl_header_bytes, std::as_bytes(std::span(&count, 1))));
    const std::uint64_t bytes = file_.position();
    SPLATVOL_TRY(file_.commit());
    return bytes;
  }

 private:
  StlFile(AtomicFile file, std::string path) : file_(std::move(file)), path_(std::move(path)) {}

  AtomicFile file_;
  std::string path_;
};

// A chunk of JSON, and one of numbers: indices, then positions.
class GlbFile final : public SurfaceFile {
 public:
  GlbFile(AtomicFile file, TempFile indices, TempFile positions, std::string path)
      : file_(std::move(file)),
        indices_(std::move(indices)),
        positions_(std::move(positions)),
        path_(std::move(path)) {}

  Status write(const SurfacePart& part) override {
    triangles_ += part.triangles.size();
    std::vector<vec3> positions;
    for (const dvec3& point : part.points) {
      SPLATVOL_TRY_ASSIGN(rounded, in_single_precision(point, path_));
      positions.push_back(rounded);
      box_.include(dvec3(rounded));
    }
    std::vector<std::uint32_t> indices;
    for (const std::array<std::uint64_t, 3>& triangle : part.triangles)
      for (const std::uint64_t vertex : triangle) indices.push_back(static_cast<std::uint32_t>(vertex));
    SPLATVOL_TRY(positions_.append(std::as_bytes(std::span(positions))));
    SPLATVOL_TRY(indices_.append(std::as_bytes(std::span(indices))));
    // Less than this, so that all indices and lengths have room in 32 bits.
    if (positions_.size() + indices_.size() >= std::uint64_t{std::numeric_limits<std::uint32_t>::max()} - 4096)
      return fail(ErrorCode::unsupported, "{}: more than the 4 GiB of a .glb file: take .vtp", path_);
    return {};
  }

  Result<std::uint64_t> finish() override {
    std::string json = text();
    json.resize((json.size() + 3) / 4 * 4, ' ');
    const std::uint64_t numbers = indices_.size() + positions_.size();
    const std::uint64_t bytes = 12 + 8 + json.size() + 8 + numbers;
    SPLATVOL_TRY(append_text(file_, "glTF"));
    SPLATVOL_TRY(append_number(file_, std::uint32_t{2}));
    SPLATVOL_TRY(append_number(file_, static_cast<std::uint32_t>(bytes)));
    SPLATVOL_TRY(append_number(file_, static_cast<std::uint32_t>(json.size())));
    SPLATVOL_TRY(append_text(file_, "JSON" + json));
    SPLATVOL_TRY(append_number(file_, static_cast<std::uint32_t>(numbers)));
    SPLATVOL_TRY(append_text(file_, std::string_view("BIN\0", 4)));
    SPLATVOL_TRY(append_all(file_, indices_));
    SPLATVOL_TRY(append_all(file_, positions_));
    SPLATVOL_TRY(file_.commit());
    return bytes;
  }

 private:
  [[nodiscard]] std::string text() const {
    return fmt::format(
        R"({{"asset":{{{},"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0}}],)"
        R"("meshes":[{{"primitives":[{{"attributes":{{"POSITION":1}},"indices":0,"material":0}}]}}],)"
        R"("materials":[{{"doubleSided":true}}],"buffers":[{{"byteLength":{}}}],)"
        R"("bufferViews":[{{"buffer":0,"byteLength":{},"target":34963}},)"
        R"({{"buffer":0,"byteOffset":{},"byteLength":{},"target":34962}}],)"
        R"("accessors":[{{"bufferView":0,"componentType":5125,"count":{},"type":"SCALAR"}},)"
        R"({{"bufferView":1,"componentType":5126,"count":{},"type":"VEC3","min":[{},{},{}],"max":[{},{},{}]}}]}})",
        glb_export_mark, indices_.size() + positions_.size(), indices_.size(), indices_.size(), positions_.size(),
        indices_.size() / sizeof(std::uint32_t), positions_.size() / sizeof(vec3), box_.low.x, box_.low.y, box_.low.z,
        box_.high.x, box_.high.y, box_.high.z);
  }

  AtomicFile file_;
  TempFile indices_, positions_;
  std::string path_;
  Box box_;
};

}  // namespace

Result<std::unique_ptr<SurfaceFile>> SurfaceFile::create(const std::string& path, std::span<const OutputArray> arrays,
                                                         Replace replace) {
  static_assert(sizeof(vec3) == 3 * sizeof(float), "positions are written as they are");
  SPLATVOL_TRY_ASSIGN(file, AtomicFile::create(path, AtomicFile::Unnamed::if_possible, replace));
  if (has_extension(path, ".stl")) return StlFile::begin(std::move(file), path);
  std::vector<TempFile> parts;
  for (std::size_t i = 0; i < 2 + arrays.size(); ++i) {
    SPLATVOL_TRY_ASSIGN(part, temp_file_beside(path));
    parts.push_back(std::move(part));
  }
  if (has_extension(path, ".glb"))
    return std::make_unique<GlbFile>(std::move(file), std::move(parts[0]), std::move(parts[1]), path);
  return std::make_unique<VtpFile>(std::move(file), std::move(parts), arrays);
}

}  // namespace splatvol
