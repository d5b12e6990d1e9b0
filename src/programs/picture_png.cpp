// Write PNG files with ITK. No other file of the programs includes ITK headers.
#include "base/fail.h"
#include "picture.h"

#include <cstring>
#include <itkImageFileWriter.h>
#include <itkPNGImageIO.h>
#include <itkRGBPixel.h>

extern "C" pliant_status picture_png(const char *path, const uint8_t *rgb, int32_t width, int32_t height)
try {
    using Image = itk::Image<itk::RGBPixel<unsigned char>, 2>;
    auto image = Image::New();
    image->SetRegions(
        Image::SizeType{{static_cast<itk::SizeValueType>(width), static_cast<itk::SizeValueType>(height)}});
    image->Allocate();
    static_assert(sizeof(Image::PixelType) == 3, "pixels are packed");
    std::memcpy(static_cast<void *>(image->GetBufferPointer()), rgb, 3 * static_cast<size_t>(width) * height);
    auto writer = itk::ImageFileWriter<Image>::New();
    writer->SetImageIO(itk::PNGImageIO::New());
    writer->SetFileName(path);
    writer->SetInput(image);
    writer->Update();
    return PLIANT_OK;
} catch (const std::exception &error) {
    return pliant_fail(PLIANT_ERROR_FILE, "%s: cannot be written: %s", path, error.what());
}
