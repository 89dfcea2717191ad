// Breaks the layering in every way that tests/layers.cmake refuses; never compiled.
#include <epoxy/gl.h>
#include <tbb/parallel_for.h>

#include "base/error.h"
#include "renderer/renderer.h"
#include "scene.h"

inline void clear() { glClear(0); }
