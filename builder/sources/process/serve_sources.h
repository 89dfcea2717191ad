// The reader process's side: opens sources and sends their pieces, and reads surfaces.
#pragma once

#include <cstdint>

#include "base/triangle_mesh.h"
#include "builder/sources/array_union.h"
#include "builder/sources/source.h"

namespace splatvol {

struct ReaderLimits {
  std::uint64_t memory;  // bytes of data; the process cannot have more
};

/// Makes this process one that reads files of strangers. It gets no more memory than granted. It cannot write files,
/// start programs or reach a network, where the kernel can forbid that. It prints nothing, and it ends when the other
/// side of the socket does.
void confine_reader(int socket, const ReaderLimits& limits);

/// Answers the requests that come from a socket until its other side closes it. Takes the descriptor.
void serve_sources(int socket, const ReaderLimits& limits, const OpenSource& open, const ListArrays& list,
                   const ReadSurface& read_surface);

}  // namespace splatvol
