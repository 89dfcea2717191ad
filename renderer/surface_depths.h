// See splatvol/surface_depths.h.
#pragma once

#include "splatvol/surface_depths.h"
