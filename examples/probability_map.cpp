// The probability of each pixel by OpenCV alone: sips-export checkpoint=sips-tiny format=onnx size=[640,480]
// (OpenCV 4, say of Debian 12, needs the size of the images; of OpenCV 5 it may be left out)
//
// g++ -O2 probability_map.cpp -o probability_map $(pkg-config --cflags --libs opencv4)
// ./probability_map sips-tiny.onnx image.png map.png

#include <iostream>

#include <opencv2/dnn.hpp>
#include <opencv2/imgcodecs.hpp>

int main(int argc, char** argv) {
    if (argc != 4) {
        std::cerr << "usage: " << argv[0] << " MODEL.onnx IMAGE MAP.png\n";
        return 1;
    }
    const cv::Mat image = cv::imread(argv[2], cv::IMREAD_GRAYSCALE);
    if (image.empty()) {
        std::cerr << argv[2] << " is no image that OpenCV reads\n";
        return 1;
    }
    cv::dnn::Net network = cv::dnn::readNetFromONNX(argv[1]);
    network.setInput(cv::dnn::blobFromImage(image));  // 1 x 1 x H x W, float, 0 to 255
    const cv::Mat output = network.forward();
    const cv::Mat probability(image.rows, image.cols, CV_32F, const_cast<float*>(output.ptr<float>()));
    cv::Mat map;
    probability.convertTo(map, CV_8U, 255);
    return cv::imwrite(argv[3], map) ? 0 : 1;
}
