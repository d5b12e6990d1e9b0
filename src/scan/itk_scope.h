/* ITK, GDCM and teem keep global state (warning window, trace flags, error stacks) and print to the console.
 * While one of these lives, this thread alone is inside them and their warnings go to the log callback. */
#ifndef PLIANT_SCAN_ITK_SCOPE_H
#define PLIANT_SCAN_ITK_SCOPE_H

#include "core/fail.h"

#include <gdcmTrace.h>
#include <itkObjectFactory.h>
#include <itkOutputWindow.h>

#include <mutex>
#include <string>

namespace pliant_read {

class log_window : public itk::OutputWindow {
public:
    using Self = log_window;
    using Superclass = itk::OutputWindow;
    using Pointer = itk::SmartPointer<Self>;
    itkFactorylessNewMacro(Self);
    void DisplayText(const char *text) override { pliant_log(PLIANT_LOG_WARNING, "ITK: %s", text); }
};

class itk_scope {
public:
    itk_scope() : lock_(mutex()), window_(itk::OutputWindow::GetInstance())
    {
        itk::OutputWindow::SetInstance(log_window::New());
        debug_ = gdcm::Trace::GetDebugFlag();
        warning_ = gdcm::Trace::GetWarningFlag();
        error_ = gdcm::Trace::GetErrorFlag();
        gdcm::Trace::SetDebug(false);
        gdcm::Trace::SetWarning(false);
        gdcm::Trace::SetError(false);
    }
    ~itk_scope()
    {
        gdcm::Trace::SetDebug(debug_);
        gdcm::Trace::SetWarning(warning_);
        gdcm::Trace::SetError(error_);
        itk::OutputWindow::SetInstance(window_);
    }
    itk_scope(const itk_scope &) = delete;
    itk_scope &operator=(const itk_scope &) = delete;

private:
    static std::mutex &mutex()
    {
        static std::mutex one;
        return one;
    }
    std::lock_guard<std::mutex> lock_;
    itk::OutputWindow::Pointer window_;
    bool debug_, warning_, error_;
};

/* What an ITK exception says, on one line, without source position and object address. */
inline std::string itk_reason(const std::exception &error)
{
    std::string text = error.what(), line;
    size_t start = text.find("): ");
    if (start != std::string::npos) text.erase(0, start + 3);
    for (char c : text) line += c == '\n' || c == '\r' ? ' ' : c;
    size_t last = line.find_last_not_of(' ');
    return line.substr(0, last == std::string::npos ? 0 : last + 1);
}

} // namespace pliant_read

#endif
