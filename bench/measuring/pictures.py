"""Pictures: reading and writing EXR, displayed colours, FLIP.

Arrays are height x width x 4, linear premultiplied RGBA, row 0 at the top."""


def read_exr(path):
    import OpenEXR

    return OpenEXR.File(str(path), separate_channels=False).channels()["RGBA"].pixels


def write_exr(path, rgba):
    import numpy
    import OpenEXR

    header = {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION}
    OpenEXR.File(header, {"RGBA": numpy.ascontiguousarray(rgba, numpy.float32)}).write(str(path))


def displayed(rgba, background):
    """Returns the picture over a linear background, with the sRGB curve: height x width x 3 in [0, 1]."""
    import numpy

    linear = numpy.clip(rgba[..., :3] + (1 - rgba[..., 3:]) * numpy.array(background, numpy.float32), 0, 1)
    curve = numpy.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return numpy.ascontiguousarray(curve, numpy.float32)


def mean_flip(reference, picture, background):
    """Returns the mean LDR-FLIP of two displayed pictures, at the metric's default of 67 pixels a degree."""
    import flip_evaluator

    return float(
        flip_evaluator.evaluate(
            displayed(reference, background), displayed(picture, background), "LDR", applyMagma=False
        )[1]
    )


def write_png(path, rgba, background, longest=256):
    """Writes a PNG. Reduces a picture with a side longer than `longest` pixels, by means of whole squares of pixels."""
    import numpy
    from PIL import Image

    step = max(1, max(rgba.shape[:2]) // longest)
    height, width = (extent // step for extent in rgba.shape[:2])
    small = rgba[: height * step, : width * step].reshape(height, step, width, step, 4).mean(axis=(1, 3))
    Image.fromarray(numpy.rint(255 * displayed(small, background)).astype(numpy.uint8)).save(path, optimize=True)


def write_difference(path, exact, picture, factor=8, size=256):
    """Writes the middle of a picture less the exact one as a PNG: grey is no difference, white 1 / (2 factor)."""
    import numpy
    from PIL import Image

    top, left = (max(extent - size, 0) // 2 for extent in exact.shape[:2])
    shown = numpy.s_[top : top + size, left : left + size, :3]
    grey = numpy.clip(0.5 + factor * (picture[shown] - exact[shown]), 0, 1)
    Image.fromarray(numpy.rint(255 * grey).astype(numpy.uint8)).save(path, optimize=True)
