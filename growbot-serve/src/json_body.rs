//! A JSON body that is parsed on a separate thread, because parsing a long body would delay other requests.

use aide::OperationInput;
use aide::generate::GenContext;
use aide::openapi::{Operation, Response as Described, StatusCode};
use axum::Json;
use axum::extract::{FromRequest, Request};
use axum::response::{IntoResponse, Response};
use futures_util::FutureExt;
use schemars::JsonSchema;
use serde::de::DeserializeOwned;
use tokio::task::spawn_blocking;

use super::problem::Problem;

/// Extractor like [`Json`] that parses the body on a separate thread. The body must have been read before.
pub struct JsonBody<T>(pub T);

impl<T: DeserializeOwned + Send + 'static, S: Sync> FromRequest<S> for JsonBody<T> {
    type Rejection = Response;

    async fn from_request(request: Request, _: &S) -> Result<Self, Response> {
        let parsed = spawn_blocking(|| Json::<T>::from_request(request, &()).now_or_never());
        match parsed.await {
            Ok(Some(Ok(Json(value)))) => Ok(Self(value)),
            Ok(Some(Err(rejection))) => Err(rejection.into_response()),
            Ok(None) => Err(Problem::internal("the body was not read before it was parsed").into_response()),
            Err(error) => Err(Problem::internal(error).into_response()),
        }
    }
}

impl<T: JsonSchema> OperationInput for JsonBody<T> {
    fn operation_input(context: &mut GenContext, operation: &mut Operation) {
        Json::<T>::operation_input(context, operation);
    }

    fn inferred_early_responses(
        context: &mut GenContext,
        operation: &mut Operation,
    ) -> Vec<(Option<StatusCode>, Described)> {
        Json::<T>::inferred_early_responses(context, operation)
    }
}
