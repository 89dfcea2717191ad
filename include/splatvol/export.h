// Marks what the shared libraries export.
#pragma once

#define SPLATVOL_EXPORT __attribute__((visibility("default")))
