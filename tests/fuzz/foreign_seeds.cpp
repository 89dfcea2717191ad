#include "tests/fuzz/foreign_seeds.h"

#include <cstdint>
#include <cstring>
#include <string_view>

#include "tests/support/openfoam_files.h"

namespace splatvol::fuzz {
namespace {

/// A binary file that is being written.
class Binary {
 public:
  explicit Binary(std::string text = {}) : text_(std::move(text)) {}

  template <class T>
  Binary& add(T number) {
    text_.append(reinterpret_cast<const char*>(&number), sizeof(T));
    return *this;
  }
  /// Adds a number with the highest byte first.
  Binary& add_big(std::uint32_t number) {
    for (const int shift : {24, 16, 8, 0}) text_ += static_cast<char>(number >> shift & 255);
    return *this;
  }
  Binary& add_text(std::string_view text, std::size_t bytes) {
    text_ += text;
    text_.append(bytes - text.size(), '\0');
    return *this;
  }
  [[nodiscard]] const std::string& text() const { return text_; }

 private:
  std::string text_;
};

std::string npy(const std::string& description, const std::string& order, const std::string& shape,
                std::size_t data_bytes) {
  const std::string header =
      "{'descr': " + description + ", 'fortran_order': " + order + ", 'shape': " + shape + ", }\n";
  std::string text = "\x93NUMPY";
  text += {'\1', '\0', static_cast<char>(header.size()), '\0'};
  text += header;
  for (std::size_t i = 0; i < data_bytes; ++i) text += static_cast<char>(i % 8 == 7 ? 0x3F : i);
  return text;
}

std::string vdb() {
  Binary file;
  file.add(std::uint64_t{0x56444220}).add(std::uint32_t{224}).add(std::uint32_t{9}).add(std::uint32_t{1});
  file.add(std::uint8_t{1}).add_text("01234567-0123-0123-0123-0123456789ab", 36);
  const auto metadata = [&] {
    file.add(std::uint32_t{1});
    for (const std::string_view part : {"name", "string", "value"})
      file.add(static_cast<std::uint32_t>(part.size())).add_text(part, part.size());
  };
  metadata();
  file.add(std::uint32_t{1});
  for (const std::string_view part : {"density", "Tree_float_5_4_3", ""})
    file.add(static_cast<std::uint32_t>(part.size())).add_text(part, part.size());
  const std::uint64_t begin = file.text().size() + 24;
  file.add(begin).add(begin + 40).add(begin + 40);
  file.add(std::uint32_t{0});
  metadata();
  return file.add_text("", 16).text();
}

// Three dimensions, of which one is that of records, and two variables.
std::string netcdf() {
  Binary file("n");
  file.add_text("CDF\1", 4).add_big(2);
  const auto name = [&](std::string_view text) {
    file.add_big(static_cast<std::uint32_t>(text.size())).add_text(text, (text.size() + 3) / 4 * 4);
  };
  file.add_big(10).add_big(3);
  for (const std::uint32_t length : {0U, 4U, 2U}) name("dim"), file.add_big(length);
  file.add_big(12).add_big(1), name("title"), file.add_big(2).add_big(4).add_text("mesh", 4);
  file.add_big(11).add_big(2);
  name("x"), file.add_big(1).add_big(1).add_big(0).add_big(0).add_big(5).add_big(16).add_big(220);
  name("p"), file.add_big(2).add_big(0).add_big(1).add_big(0).add_big(0).add_big(6).add_big(32).add_big(236);
  return file.add_text("", 120).text();
}

std::string hdf5() {
  Binary file("n\x89HDF\r\n\x1a\n");
  file.add(std::uint8_t{0}).add_text("", 4).add(std::uint8_t{8}).add_text("", 26).add(std::uint64_t{96});
  return file.add_text("", 48).text();
}

std::string plot3d(bool marks) {
  Binary grid, solution;
  const auto record = [&](Binary& file, const std::string& bytes) {
    if (marks) file.add(static_cast<std::uint32_t>(bytes.size()));
    file.add_text(bytes, bytes.size());
    if (marks) file.add(static_cast<std::uint32_t>(bytes.size()));
  };
  const std::string sides = Binary().add(2).add(2).add(3).text();
  record(grid, sides);
  record(grid, std::string(12 * 3 * 4, '\1'));
  record(solution, sides);
  record(solution, std::string(16, '\1'));
  record(solution, std::string(12 * 5 * 4, '\1'));
  Binary both("p");
  both.add(static_cast<std::uint16_t>(grid.text().size()));
  return both.text() + grid.text() + solution.text();
}

constexpr std::string_view legacy_unstructured = R"(# vtk DataFile Version 3.0
a mesh
ASCII
DATASET UNSTRUCTURED_GRID
POINTS 4 double
0 0 0 1 0 0 0 1 0 0 0 1
CELLS 1 5
4 0 1 2 3
CELL_TYPES 1
10
POINT_DATA 4
SCALARS p double 1
LOOKUP_TABLE default
1 2 3 4
VECTORS U float
1 2 3 1 2 3 1 2 3 1 2 3
FIELD FieldData 1
q 2 4 int
1 2 3 4 5 6 7 8
METADATA
INFORMATION 0

CELL_DATA 1
SCALARS c float
LOOKUP_TABLE default
5
)";

constexpr std::string_view legacy_offsets = R"(# vtk DataFile Version 5.1
a mesh
ASCII
DATASET UNSTRUCTURED_GRID
POINTS 4 float
0 0 0 1 0 0 0 1 0 0 0 1
CELLS 2 4
OFFSETS vtktypeint64
0 4
CONNECTIVITY vtktypeint64
0 1 2 3
CELL_TYPES 1
10
)";

constexpr std::string_view legacy_structured = R"(# vtk DataFile Version 3.0
a grid
ASCII
DATASET RECTILINEAR_GRID
DIMENSIONS 2 2 2
X_COORDINATES 2 float
0 1
Y_COORDINATES 2 float
0 1
Z_COORDINATES 2 float
0 1
POINT_DATA 8
SCALARS p float 1
LOOKUP_TABLE default
1 2 3 4 5 6 7 8
)";

constexpr std::string_view legacy_points = R"(# vtk DataFile Version 3.0
an image
ASCII
DATASET STRUCTURED_POINTS
DIMENSIONS 2 2 2
ORIGIN 0 0 0
SPACING 1 1 1
POINT_DATA 8
SCALARS p float 1
LOOKUP_TABLE default
1 2 3 4 5 6 7 8
)";

std::string legacy_binary() {
  Binary file("# vtk DataFile Version 3.0\na mesh\nBINARY\nDATASET UNSTRUCTURED_GRID\nPOINTS 4 float\n");
  file.add_text("", 48).add_text("\nCELLS 1 5\n", 11).add_big(4).add_big(0).add_big(1).add_big(2).add_big(3);
  file.add_text("\nCELL_TYPES 1\n", 14).add_big(10);
  const std::string_view data = "\nPOINT_DATA 4\nSCALARS p float 1\nLOOKUP_TABLE default\n";
  return file.add_text(data, data.size()).add_text("", 16).add_text("\n", 1).text();
}

constexpr std::string_view gmsh_2 = R"($MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
1
2 1 "wall"
$EndPhysicalNames
$Nodes
4
1 0 0 0
2 1 0 0
3 0 1 0
4 0 0 1
$EndNodes
$Elements
2
1 4 2 1 1 1 2 3 4
2 2 2 1 1 1 2 3
$EndElements
$NodeData
1
"f"
1
0.5
3
0
1
4
1 1
2 2
3 3
4 4
$EndNodeData
$ElementNodeData
1
"g"
1
0
3
0
1
1
1 4 1 2 3 4
$EndElementNodeData
)";

constexpr std::string_view gmsh_4 = R"($MeshFormat
4.1 0 8
$EndMeshFormat
$Entities
1 1 1 1
1 0 0 0 0
1 0 0 0 1 1 1 0 2 1 -1
1 0 0 0 1 1 1 1 -5 1 1
1 0 0 0 1 1 1 0 1 1
$EndEntities
$Nodes
1 4 1 4
3 1 0 4
1
2
3
4
0 0 0
1 0 0
0 1 0
0 0 1
$EndNodes
$Elements
2 2 1 2
3 1 4 1
1 1 2 3 4
2 1 2 1
2 1 2 3
$EndElements
$ElementData
1
"f"
1
0
3
0
1
1
1 5
$EndElementData
)";

std::string gmsh_binary() {
  Binary file("$MeshFormat\n2.2 1 8\n");
  file.add(1).add_text("\n$EndMeshFormat\n$Nodes\n4\n", 25);
  for (int node = 1; node <= 4; ++node)
    file.add(node).add(node == 2 ? 1.0 : 0).add(node == 3 ? 1.0 : 0).add(node == 4 ? 1.0 : 0);
  file.add_text("\n$EndNodes\n$Elements\n1\n", 23).add(4).add(1).add(2).add(1).add(1).add(1);
  for (int node = 1; node <= 4; ++node) file.add(node);
  return file.add_text("\n$EndElements\n", 14).text();
}

constexpr std::string_view obj = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nvt 0 0\nf 1/1/1 2/1/1 \\\n3/1/1\nf -3 -2 -1\n";
constexpr std::string_view stl =
    "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid "
    "a\n";
constexpr std::string_view ply = "ply\nformat ";
constexpr std::string_view ply_header =
    "element vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n"
    "property list uchar int vertex_indices\nend_header\n";

constexpr std::string_view su2 =
    "% two cells\nNDIME= 3\nNELEM= 2\n12 0 1 2 3 4 5 6 7 0\n14 4 5 6 7 8 1\nNPOIN= 9\n"
    "0 0 0 0\n1 0 0 1\n1 1 0 2\n0 1 0 3\n0 0 1 4\n1 0 1 5\n1 1 1 6\n0 1 1 7\n0.5 0.5 2 8\nNMARK= 1\n"
    "MARKER_TAG= wall\nMARKER_ELEMS= 1\n9 0 1 2 3\n";

constexpr std::string_view su2_values =
    "\"PointID\",\"x\",\"y\",\"z\",\"f\"\n0,0,0,0,1\n1,1,0,0,1\n2,1,1,0,1\n3,0,1,0,1\n"
    "4,0,0,1,1\n5,1,0,1,1\n6,1,1,1,1\n7,0,1,1,1\n8,.5,.5,2,1\n";

/// A case as fuzz_openfoam takes it. `extra`: instead of files of the case.
std::string openfoam(const test::FoamLayout& layout, const std::map<std::string, std::string>& extra = {}) {
  std::string text;
  std::map<std::string, std::string> files = test::openfoam_files(layout);
  for (const auto& [name, body] : extra) files[name] = body;
  for (const auto& [name, body] : files) text += "==> " + name + "\n" + body;
  return text;
}

constexpr std::string_view vtu = R"(<?xml version="1.0"?>
<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" header_type="UInt64">
<UnstructuredGrid><Piece NumberOfPoints="4" NumberOfCells="1">
<PointData><DataArray type="Float64" Name="p" format="ascii">1 2 3 4</DataArray></PointData>
<Points><DataArray type="Float32" Name="Points" NumberOfComponents="3" format="binary">
MAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAA
</DataArray></Points>
<Cells><DataArray type="Int64" Name="connectivity" format="ascii">0 1 2 3</DataArray>
<DataArray type="Int64" Name="offsets" format="ascii">4</DataArray>
<DataArray type="UInt8" Name="types" format="ascii">10</DataArray></Cells>
</Piece></UnstructuredGrid></VTKFile>
)";

std::string vti() {
  Binary file(R"(<?xml version="1.0"?>
<VTKFile type="ImageData" version="1.0" byte_order="LittleEndian" header_type="UInt32" compressor="vtkZLibDataCompressor">
<ImageData WholeExtent="0 1 0 1 0 1" Origin="0 0 0" Spacing="1 1 1"><Piece Extent="0 1 0 1 0 1">
<PointData><DataArray type="Float32" Name="p" format="appended" offset="0"/></PointData></Piece></ImageData>
<AppendedData encoding="raw">_)");
  file.add(1U).add(32U).add(0U).add(20U).add_text("", 20);
  return file.text() + "</AppendedData></VTKFile>\n";
}

constexpr std::string_view ensight_case = R"(FORMAT
type: ensight gold
GEOMETRY
model: 1 flow**.geo change_coords_only
VARIABLE
scalar per node: 1 p flow**.p
vector per element: 1 U flow**.U
TIME
time set: 1
number of steps: 2
filename start number: 0
filename increment: 1
time values: 0.0 0.5
FILE
file set: 1
number of steps: 2
)";

constexpr std::string_view ensight_text = R"(a geometry
by hand
node id off
element id off
part
         1
a part
coordinates
         4
 0.0
 1.0
 0.0
 0.0
 0.0
 0.0
 1.0
 0.0
 0.0
 0.0
 0.0
 1.0
tetra4
         1
         1         2         3         4
)";

std::string ensight_binary() {
  Binary file(std::string("e\0", 2));
  for (const std::string_view line : {"C Binary", "a geometry", "by hand", "node id off", "element id off", "part"})
    file.add_text(line, 80);
  file.add(1).add_text("a part", 80).add_text("coordinates", 80).add(4).add_text("", 48);
  return file.add_text("tetra4", 80).add(1).add(1).add(2).add(3).add(4).text();
}

}  // namespace

std::vector<std::pair<std::string, std::string>> foreign_seeds() {
  const std::string ensight = "e" + std::string(ensight_case);
  return {
      {"fuzz_npy", npy("'<f8'", "False", "(3, 4)", 96)},
      {"fuzz_npy", npy("'>f4'", "True", "(3, 5)", 60)},
      {"fuzz_npy", npy("[('x', '<f4'), ('y', '<f4'), ('z', '<f4'), ('p', '>i2'), ('s', 'S3')]", "False", "(2,)", 34)},
      {"fuzz_csv", "x,y,z,h,rho [kg/m^3]\n0,0,0,1,2\n1,0,0,nan,3\n0,1,0,,4e3\n0,0,1,1.5D+03,5\n"},
      {"fuzz_csv", "# a comment\n\"Points:0\";\"Points:1\";\"Points:2\";name;p\n0;0;0;\"a;b\";1\n1;0;1;c;-\n"},
      {"fuzz_csv", "X [m]\tY [m]\tZ [m]\tT\n1\t2\t3\t4\n5\t6\t7\t8\r\n"},
      {"fuzz_csv", "% Model:  a.mph\n% x   y   z   T (K) @ t=1\n1  2 3  4\n% half\n5 6 7 8\n"},
      {"fuzz_csv",
       "[Name]\na\n\n[Data]\nX [ m ], Y [ m ], Z [ m ], p [ Pa ], X [ m ]\n1, 2, 3, null, 1\n[Faces]\n0, 1\n"},
      {"fuzz_vdb_header", vdb()},
      {"fuzz_legacy_checks", std::string(legacy_unstructured)},
      {"fuzz_legacy_checks", std::string(legacy_offsets)},
      {"fuzz_legacy_checks", std::string(legacy_structured)},
      {"fuzz_legacy_checks", std::string(legacy_points)},
      {"fuzz_legacy_checks", legacy_binary()},
      {"fuzz_gmsh", std::string(gmsh_2)},
      {"fuzz_gmsh", std::string(gmsh_4)},
      {"fuzz_gmsh", gmsh_binary()},
      {"fuzz_gmsh", "# c\n$Comments\n1\n$EndComments\n" + std::string(gmsh_2)},
      {"fuzz_gmsh_mesh", std::string(gmsh_2)},
      {"fuzz_gmsh_mesh", std::string(gmsh_4)},
      {"fuzz_su2", std::string(su2) + '\0' + std::string(su2_values)},
      {"fuzz_openfoam", openfoam({})},
      {"fuzz_openfoam", openfoam({.binary = true})},
      {"fuzz_openfoam", openfoam({.binary = true, .big_endian = true, .label_bytes = 8, .scalar_bytes = 4})},
      {"fuzz_openfoam", openfoam({.packed = true})},
      {"fuzz_openfoam", openfoam({.processors = 2, .region = "fluid"})},
      {"fuzz_openfoam", openfoam({.binary = true, .processors = 3, .collated = {2, 1}})},
      {"fuzz_openfoam",
       openfoam({}, {{"0.5/p", test::foam_file("volScalarField",
                                               "#include \"settings\"\n#inputMode merge\ndimensions [kg/(m s^2)];\n"
                                               "internalField uniform $!inner/p [bar];\nboundaryField { $a; }\n")},
                     {"0.5/settings", "inner { p 1; } a { $inner; } b ${inner}; #include \"$FOAM_CASE/more\"\n"},
                     {"more", "c \"(a|b)\"; d #{ code #};"}})},
      {"fuzz_su2", std::string(su2) +
                       "MARKER_TAG= SEND_RECEIVE\nMARKER_ELEMS= 1\nSEND_RECV= 1\n1 0 0\nFFD_NBOX= 1\n"
                       "FFD_CORNER_POINTS= 1\n0 0 0\n" +
                       '\0' + std::string(su2_values)},
      {"fuzz_xml_checks", std::string(vtu)},
      {"fuzz_xml_checks", vti()},
      {"fuzz_formats", ensight},
      {"fuzz_formats", std::string("e\0", 2) + std::string(ensight_text)},
      {"fuzz_formats", ensight_binary()},
      {"fuzz_formats", std::string("e\0", 2) + "q\npart\n1\ng_tetra4 undef\n-9\n1\ntetra4 partial\n1\n2\n***\n"},
      {"fuzz_formats", netcdf()},
      {"fuzz_formats", hdf5()},
      {"fuzz_formats", plot3d(false)},
      {"fuzz_formats", plot3d(true)},
      {"fuzz_formats",
       R"(g{"scenes":[{"nodes":[0]}],"nodes":[{"children":[1,1]},{"mesh":0}],"meshes":[{"primitives":[{}]}]})"},
      {"fuzz_formats", "o" + std::string(obj)},
      {"fuzz_formats", "s" + std::string(stl)},
      {"fuzz_formats",
       "y" + std::string(ply) + "ascii 1.0\n" + std::string(ply_header) + "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"},
      {"fuzz_formats", "y" + std::string(ply) + "binary_little_endian 1.0\n" + std::string(ply_header) +
                           std::string(36, '\0') + '\3' + std::string(12, '\0')},
  };
}

}  // namespace splatvol::fuzz
