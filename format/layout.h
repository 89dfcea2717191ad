// The records of fixed size of a .svol file (spec/svol-1.md), as they are on the disk: little-endian, no padding.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>

namespace splatvol::format {

static_assert(std::endian::native == std::endian::little, "records are copied as they are");

inline constexpr std::uint8_t magic[8] = {0x89, 'S', 'V', 'O', 'L', 0x0D, 0x0A, 0x1A};
inline constexpr std::uint8_t step_magic[8] = {0x89, 'S', 'V', 'S', 'T', 0x0D, 0x0A, 0x1A};
inline constexpr std::uint8_t footer_magic[8] = {'S', 'V', 'O', 'L', 'E', 'N', 'D', '\n'};
inline constexpr std::uint16_t major_version = 1;
inline constexpr std::uint16_t minor_version = 0;
inline constexpr std::uint16_t boundary_minor_version = 1;   // of a file with the section `boundary`
inline constexpr std::uint16_t cells_minor_version = 2;      // of a file with the section `cells`
inline constexpr std::uint16_t two_sided_minor_version = 3;  // of a file with two-sided triangles
inline constexpr std::uint64_t max_preamble_bytes = 1u << 20;
inline constexpr std::uint64_t min_first_read_bytes = 32u << 10;
inline constexpr std::uint64_t max_first_read_bytes = 512u << 10;
inline constexpr std::size_t max_resolutions = 64;
inline constexpr std::size_t max_attributes = 65535;
inline constexpr std::size_t max_size_bounds = 16;
inline constexpr std::size_t max_octant_depth = 64;  // of the column
inline constexpr std::size_t max_node_depth = 42;    // of the index: deeper nodes have no Morton key
inline constexpr std::uint64_t max_page_nodes = 4096;
inline constexpr std::uint64_t max_step_entries = 1u << 20;  // of a step directory
inline constexpr std::size_t max_patches = 4096;             // of a boundary
inline constexpr std::uint32_t series_feature = 1;           // of Superblock::critical_features
inline constexpr std::uint32_t max_page_chunks = 256;        // of cells
inline constexpr std::uint32_t max_chunk_cells = 1u << 16;
inline constexpr std::uint32_t max_chunk_corners = 1u << 19;  // of all of its cells
inline constexpr std::uint32_t max_chunk_groups = 4096;       // that the cells of a chunk have their corners in
inline constexpr std::uint32_t rank_page_points = 1u << 16;
inline constexpr std::uint32_t vertex_page_points = 1u << 12;

struct Superblock {                  // spec 2
  std::uint8_t magic[8];             //  0
  std::uint16_t major_version;       //  8
  std::uint16_t minor_version;       // 10
  std::uint32_t critical_features;   // 12
  std::uint64_t file_bytes;          // 16
  std::uint64_t preamble_bytes;      // 24
  std::uint32_t section_count;       // 32
  std::uint32_t reserved0;           // 36
  std::uint64_t section_table_hash;  // 40
  std::uint64_t step_directory;      // 48: its offset; 0: the file is no series
  std::uint64_t hash;                // 56: of bytes 0 to 55
};
static_assert(sizeof(Superblock) == 64 && offsetof(Superblock, hash) == 56);

enum class SectionKind : std::uint32_t {
  metadata = 1,
  index_root = 2,
  directory_root = 3,
  rows = 4,
  index_pages = 5,
  directory_pages = 6,
  histograms = 7,
  padding = 8,
  summary_table = 9,  // of a step
  boundary = 10,
  cells = 13,           // 11 and 12 were those of a draft
  cell_summaries = 14,  // of a step
};

/// Returns the largest unpacked size of metadata of `packed_bytes` (rule R7). JSON takes many times its length in
/// memory.
[[nodiscard]] constexpr std::uint64_t max_metadata_bytes(std::uint64_t packed_bytes) {
  const std::uint64_t by_ratio = (1u << 16) + 64 * packed_bytes;
  return by_ratio < (1u << 22) ? by_ratio : 1u << 22;
}

enum class Codec : std::uint32_t { raw = 0, zstd = 1, extent = 2 };

struct SectionEntry {            // spec 3
  SectionKind kind;              //  0
  std::uint32_t flags;           //  4: bit 0: critical
  std::uint64_t offset;          //  8
  std::uint64_t packed_bytes;    // 16
  std::uint64_t unpacked_bytes;  // 24
  std::uint64_t hash;            // 32
  Codec codec;                   // 40
  std::uint32_t reserved;        // 44
};
static_assert(sizeof(SectionEntry) == 48 && offsetof(SectionEntry, codec) == 40);

struct ChunkEntry {              // spec 5
  std::uint64_t hash;            //  0: of the packed bytes
  std::uint32_t packed_bytes;    //  8
  std::uint32_t unpacked_bytes;  // 12
  float min;                     // 16
  float max;                     // 20
  std::uint64_t occupancy;       // 24
};
static_assert(sizeof(ChunkEntry) == 32 && offsetof(ChunkEntry, occupancy) == 24);

struct DirectoryPageRef {  // spec 5
  std::uint64_t offset;    //  0: from the start of the file
  std::uint64_t bytes;     //  8
  std::uint64_t hash;      // 16
};
static_assert(sizeof(DirectoryPageRef) == 24);

struct IndexPagePart {           // spec 6
  std::uint32_t packed_bytes;    //  0
  std::uint32_t unpacked_bytes;  //  4
  std::uint64_t hash;            //  8
};
static_assert(sizeof(IndexPagePart) == 16);

struct IndexPageRef {         // spec 6
  std::uint64_t offset;       //  0: within the section of index pages
  std::uint32_t front_bytes;  //  8: up to the end of the structure part
  std::uint32_t page_bytes;   // 12
  std::uint64_t hash;         // 16: of the node count and the part table
};
static_assert(sizeof(IndexPageRef) == 24 && offsetof(IndexPageRef, hash) == 16);

struct PositionHeader {      // spec 8
  std::uint8_t form;         //  0: 1 grid, 2 exact
  std::uint8_t width[3];     //  1: bytes of q on each axis
  std::uint32_t zero;        //  4
  double error;              //  8
  double origin[3];          // 16
  double quantisation_step;  // 40
};
static_assert(sizeof(PositionHeader) == 48 && offsetof(PositionHeader, quantisation_step) == 40);

struct MomentsHeader {             // spec 8
  double mass_scale;               //  0
  double deviation_scale;          //  8
  std::uint8_t orientation_width;  // 16: bytes of an orientation
  std::uint8_t zero[7];            // 17
};
static_assert(sizeof(MomentsHeader) == 24);

struct ValueHeader {         // spec 8
  std::uint8_t form;         //  0: 1 grid, 2 exact
  std::uint8_t width;        //  1: bytes of a code
  std::uint8_t zero[6];      //  2
  double origin;             //  8
  double quantisation_step;  // 16
};
static_assert(sizeof(ValueHeader) == 24 && offsetof(ValueHeader, quantisation_step) == 16);

struct ValueMomentsHeader {      // spec 8
  std::uint8_t form;             //  0: of the means: 1 steps, 2 exact
  std::uint8_t width;            //  1: bytes of a mean
  std::uint8_t deviation_width;  //  2: bytes of a deviation
  std::uint8_t zero[5];          //  3
  double origin;                 //  8
  double least_step;             // 16
  double deviation_scale;        // 24
};
static_assert(sizeof(ValueMomentsHeader) == 32 && offsetof(ValueMomentsHeader, deviation_scale) == 24);

struct SummaryPageRef {      // spec 11
  std::uint64_t offset;      //  0: within the section of pages
  std::uint32_t page_bytes;  //  8
  std::uint32_t node_count;  // 12
  std::uint64_t hash;        // 16: of the part table
};
static_assert(sizeof(SummaryPageRef) == 24);

struct PatchPart {               // spec 13
  std::uint64_t hash;            //  0: of the packed bytes
  std::uint32_t packed_bytes;    //  8
  std::uint32_t unpacked_bytes;  // 12
};
static_assert(sizeof(PatchPart) == 16);

enum class CellShape : std::uint8_t { tetrahedron = 1, pyramid = 2, wedge = 3, hexahedron = 4, polyhedron = 5 };
enum class CellField : std::uint8_t {
  corners = 1,   // linear between the values of the points at the corners
  constant = 2,  // the value of one point in all of the cell, whose corners are vertices of their own
};

struct CellChunkEntry {          // spec 14
  std::uint64_t offset;          //  0: within the section
  std::uint64_t hash;            //  8: of the packed bytes
  std::uint32_t packed_bytes;    // 16
  std::uint32_t unpacked_bytes;  // 20
  std::uint32_t cells;           // 24
  std::uint32_t points;          // 28: different ones among the corners
  CellShape shape;               // 32
  CellField field;               // 33
  std::uint8_t zero[6];          // 34
  double low[3];                 // 40: box round the corners
  double high[3];                // 64
  double area;                   // 88: of the faces of all cells
};
static_assert(sizeof(CellChunkEntry) == 96 && offsetof(CellChunkEntry, area) == 88);

struct CellPageRef {            // spec 14
  std::uint64_t offset;         //  0: within the section
  std::uint32_t page_bytes;     //  8
  std::uint32_t chunks;         // 12
  std::uint64_t hash;           // 16: of the part table
  std::uint64_t chunks_offset;  // 24: of its first chunk, within the section
  double low[3];                // 32: box round the chunks
  double high[3];               // 56
  double area;                  // 80: of all chunks
};
static_assert(sizeof(CellPageRef) == 88 && offsetof(CellPageRef, area) == 80);

struct PackedPageRef {           // spec 14: a page of ranks or of vertices
  std::uint64_t offset;          //  0: within the section
  std::uint32_t packed_bytes;    //  8
  std::uint32_t unpacked_bytes;  // 12
  std::uint64_t hash;            // 16: of the packed bytes
};
static_assert(sizeof(PackedPageRef) == 24);

struct CellKind {              // spec 14
  CellShape shape;             //  0
  CellField field;             //  1
  std::uint8_t zero[6];        //  2
  std::uint64_t cells;         //  8
  std::uint64_t packed_bytes;  // 16: of their chunks
  std::uint64_t turned;        // 24: cells that rounding has turned inside out
};
static_assert(sizeof(CellKind) == 32);

struct CellsTail {         // spec 14
  std::uint64_t hash;      //  0: of the rest of the root before it
  std::uint64_t chunks;    //  8
  std::uint64_t pages;     // 16: of chunk entries
  std::uint64_t vertices;  // 24
  std::uint32_t kinds;     // 32
  std::uint32_t version;   // 36: cells_version
};
static_assert(sizeof(CellsTail) == 40);
inline constexpr std::uint32_t cells_version = 1;

struct StepDirectoryHead {   // spec 11
  std::uint64_t hash;        //  0: of all bytes of the step directory behind it
  std::uint64_t entries;     //  8
  std::uint64_t attributes;  // 16
};
static_assert(sizeof(StepDirectoryHead) == 24);

enum class StepEntryKind : std::uint32_t { step = 0, dead = 1 };

struct StepEntry {       // spec 11
  double time;           //  0
  std::uint64_t offset;  //  8
  std::uint64_t bytes;   // 16
  std::uint64_t hash;    // 24: of a step's superblock and section table; of all bytes of a dead part
  StepEntryKind kind;    // 32
  std::uint32_t zero;    // 36
};
static_assert(sizeof(StepEntry) == 40 && offsetof(StepEntry, kind) == 32);

struct StepRange {  // spec 11: of an attribute over all steps; NaN: no value is present
  double min;       //  0
  double max;       //  8
};
static_assert(sizeof(StepRange) == 16);

struct Footer {              // spec 10
  std::uint8_t magic[8];     //  0
  std::uint64_t file_bytes;  //  8
  std::uint64_t table_hash;  // 16: of superblock and section table
  std::uint64_t hash;        // 24: of bytes 0 to 23
};
static_assert(sizeof(Footer) == 32);

}  // namespace splatvol::format
